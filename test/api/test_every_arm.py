# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every model: its SPEL+ point at zero, a joint move and a line within its limits."""

from itertools import cycle
from types import SimpleNamespace

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.controller_harness import Remote
from support.driver_harness import Harness, Submitted, simulated
from support.event_loop import run
from support.examples import one_in

from epson_driver.driver.delivery.delivery import delivery_rules
from epson_driver.driver.goal.goal import Goal
from epson_driver.driver.outcome import End
from epson_driver.motion import Array
from epson_driver.motion.point_to_point import straight
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import RobotModel, load_robot_model, robot_models
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.model import SCARA
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.tool_motion.pose_path import line, runs
from epson_driver.tool_motion.tool_trajectory import ToolLimits, trajectory_along_runs

BENT = [30.0, 60.0, -40.0, 10.0]
"""Non-singular joints of a SCARA, degrees and mm."""

SIX = [10.0, -20.0, 20.0, 5.0, -60.0, 10.0]  # degrees


def _bent(model: RobotModel) -> Array:
    if model.kind == SCARA:
        return np.array(BENT) / model.shown_per_unit
    x, _, z = model.chain.origins[2]
    lean = float(np.arctan2(x, abs(z)))  # of the upper arm at zero
    return np.radians(SIX) + lean * np.array((0.0, 1.0, -1.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize('name', one_in(5, robot_models()))
def test_spel_program_and_python_compute_the_same_pose_at_zero(name: str) -> None:
    model = load_robot_model(name)
    zero = np.zeros(len(model.joint_names))
    controller = new_controller(model, load_controller_profile('simulated'), zero)
    remote = Remote(SimpleNamespace(controller=controller))
    place, _ = Kinematics(model).epson_point(zero)
    shown = remote('Sim,print,CX(CurPos),CZ(CurPos)').removeprefix('#Sim,').split(' ')
    assert [float(word) for word in shown] == pytest.approx(place[[0, 2]] * 1e3, abs=2e-3)
    if model.kind == SCARA:
        assert float(shown[1]) == pytest.approx(0.0, abs=1e-6)


MODELS_AND_PROFILES = list(zip(robot_models(), cycle(['simulated', 'spel'])))
"""Each model has one controller of two. The models of a series differ in size and mount only."""


@pytest.mark.parametrize(('name', 'profile'), one_in(121, MODELS_AND_PROFILES, several=True))
def test_driver_executes_a_joint_move_and_a_line(name: str, profile: str) -> None:
    """Runs over TCP, in virtual time, with the built-in and the SPEL+ program."""
    model = load_robot_model(name)
    arm, limits = Kinematics(model), model.limits
    zero, for_folding_arm = np.zeros(len(limits.names)), _bent(model)
    there = arm.forward(for_folding_arm)
    there[2, 3] -= 0.02
    tool = ToolLimits(0.1, 1.0, 0.5, 5.0, 1e-4)
    down = trajectory_along_runs(
        arm, for_folding_arm, runs([line(arm.forward(for_folding_arm), there)], []), tool
    )
    plan = straight(zero, for_folding_arm, limits, 0.3, 0.3, sampled=False)
    controlled_by = load_controller_profile(profile)
    options = {
        'limits': limits,
        'motors': controlled_by.program.motors,
        'delivery': delivery_rules(controlled_by, 'streaming', 'joint_traj_pt'),
    }

    async def check() -> None:
        async with (
            simulated(model=name, profile=profile) as (controller, ports),
            Harness(ports, **options) as harness,
        ):
            await harness.ready()
            await harness.commands.enable()
            for trajectory in (plan, down):
                goal = Goal(trajectory, np.full(len(zero), 1e-3), 5.0, units=limits.units)
                submitted = Submitted(goal)
                harness.driver.goal_queue.submit(submitted.handle)
                outcome = await submitted.end()
                assert outcome.end is End.SUCCEEDED, outcome
            at = np.array(controller.joint_position().joints[: len(zero)])
            np.testing.assert_allclose(
                arm.forward(at), there, atol=2e-5
            )  # a pulse of a T3 is 8e-6 rad

    run(check())


def test_connect_logs_the_unconfirmed_data_of_a_model(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def connected(model: str) -> None:
        async with robot_cell(model=model, enabled=False):
            pass

    run(connected('t6_602s'))
    logged = [message for message in caplog.messages if 'compare them with yours' in message]
    assert logged == list(load_robot_model('t6_602s').cautions)
    caplog.clear()
    run(connected('c3_a601s'))
    assert 'compare' not in caplog.text
