# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A robot with seven joints is a file: nothing in the simulated controller counts to six."""

import numpy as np
import pytest
from support.controller_harness import PROFILE, Harness, InlinePlanner, point
from support.longer_arm import arm_model
from support.remote_harness import Remote

from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.faults.fault_kinds import FaultError
from epson_driver.sim_controller.faults.fault_text import parse

GOAL = (0.1, -0.2, 0.3, -0.1, 0.2, -0.3, 0.5)


@pytest.fixture
def model(tmp_path):
    return arm_model(tmp_path, 7)


@pytest.mark.parametrize('smooth', [False, True])
def test_all_seven_joints_go_to_the_point_within_their_limits(model, smooth):
    harness = Harness(model=model, planner=InlinePlanner() if smooth else None)
    harness.send(point(0, GOAL))
    trace = harness.run(dt=0.001)
    assert harness.joints == pytest.approx(GOAL, abs=1e-6)
    assert trace.shape[1] == 7
    assert np.all(np.abs(np.diff(trace, axis=0)) <= model.limits.velocity * 0.001 * 1.001)
    message = harness.controller.joint_position()
    assert message.joints[7:] == (0.0, 0.0, 0.0)
    harness.send(point(1, (*GOAL[:6], 7.0)))
    assert [reply.reply_code for reply in harness.replies()][-1] == 2
    assert harness.error == 4001


def test_remote_commands_know_the_seventh_joint(model):
    remote = Remote(Harness(model=model, motors=False))
    assert remote('Sim,print,Agl(7)') == '#Sim,0.000'
    assert remote('Sim,print,Agl(8)') == '!Sim,15'
    assert remote('Execute,"HomeSet 0,0,0,0,0,0,100"') == '#Execute,0'
    assert remote('Execute,"HomeSet 0,0,0,0,0,0"') == '!Execute,12'
    assert remote('Sim,disturb,7,3.0') == '#Sim,0'
    assert remote('Sim,print,Agl(7)') == '#Sim,3.000'


def test_faults_reach_the_seventh_joint_and_no_other(model):
    harness = Harness(model=model)
    harness.controller.faults.start(parse('servo_error 7'))
    assert harness.error == 5042
    with pytest.raises(FaultError, match='the robot has 7 joints'):
        harness.controller.faults.start(parse('servo_error 8'))


def test_ten_joints_are_served_and_more_than_a_message_carries_are_refused(tmp_path):
    assert len(Harness(model=arm_model(tmp_path, 10)).joints) == 10
    with pytest.raises(ValueError, match='joints: 11 joints: a message carries at most 10'):
        new_controller(arm_model(tmp_path, 11), PROFILE)
