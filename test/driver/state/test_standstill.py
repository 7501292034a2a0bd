# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Rest is judged by the measurement time of samples, not by their arrival (invariant 5)."""

import numpy as np
import pytest

from epson_driver.driver.state.robot_state import RobotState
from epson_driver.driver.state.standstill import REST_TIME_S, Standstill
from epson_driver.simple_message import Status, TriState, joint_data

pytestmark = pytest.mark.invariant(5)

STOPPED = np.array([0.01])
BEGIN = 100.0


@pytest.mark.parametrize('delay', [0.0, 0.3])
@pytest.mark.parametrize('in_motion', [TriState.FALSE, TriState.UNKNOWN])
def test_inv5_samples_from_before_the_motion_are_not_rest_after_it(delay, in_motion):
    """A delayed network shows the arm at rest before the motion."""
    robot, standstill = RobotState(1), Standstill(BEGIN)
    sent = BEGIN
    standstill.expect(None)
    after = BEGIN + 0.5

    def receive(sent, late):
        robot.on_status(Status(in_motion=in_motion), sent + late)
        sample = robot.on_joints(joint_data([0.0]), sent + 0.005 + late)
        if sample is not None:
            standstill.update(sample, robot, STOPPED, sent + late)
        return sample

    while sent < after:
        receive(sent, 0.0)
        sent += 0.01
    standstill.expect(after)
    hold = after + delay
    reached = []
    while sent < after + 1.0:
        sample = receive(sent, max(hold - sent, 0.0))
        reached.append((sent, standstill.reached(sample.measured)))
        sent += 0.01
    first = next(time for time, at_rest in reached if at_rest)
    assert first >= after + REST_TIME_S - 0.02
    assert first < after + REST_TIME_S + 0.05


def test_inv5_burst_measured_before_the_expected_motion_is_not_rest():
    robot, standstill = RobotState(1), Standstill(BEGIN)
    for count in range(100):
        robot.on_joints(joint_data([0.0]), BEGIN + count * 0.005)
    standstill.expect(BEGIN + 0.7)
    for _ in range(40):  # 0.2 s of samples, read at 0.71 s
        sample = robot.on_joints(joint_data([0.0]), BEGIN + 0.71)
        standstill.update(sample, robot, STOPPED, BEGIN + 0.71)
        assert standstill._since is None


@pytest.mark.parametrize(('rest', 'remaining'), [(REST_TIME_S, 0.0), (1.0, 1.0 - REST_TIME_S)])
def test_inv5_standstill_before_the_report_of_rest_counts_up_to_the_rest_time(rest, remaining):
    robot, standstill = RobotState(1), Standstill(BEGIN)
    standstill.expect(BEGIN, rest)

    def receive(at, in_motion):
        robot.on_status(Status(in_motion=in_motion), at)
        sample = robot.on_joints(joint_data([0.0]), at)
        if sample is None:  # one position has no velocity
            return False
        standstill.update(sample, robot, STOPPED, at)
        return standstill.reached(sample.measured)

    steps = BEGIN + 0.01 * np.arange(1, 150)
    assert not any(receive(at, TriState.TRUE) for at in steps[:40].tolist())
    first = next(at for at in steps[40:].tolist() if receive(at, TriState.FALSE))
    assert first - steps[40] == pytest.approx(remaining, abs=0.02)
