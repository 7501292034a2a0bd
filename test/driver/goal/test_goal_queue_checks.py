# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The goal queue checks every goal, whoever submits it: nothing passes it by."""

import numpy as np
import pytest
from support.driver_harness import HOME, JOINTS, LIMITS, Submitted, cell, pose
from support.event_loop import run

from epson_driver.driver.goal.goal import Goal
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.motion import Trajectory

TIMES = np.array([0.0, 1.0])
WAY = np.array([HOME, pose(0.2)])
TOLERANCE = np.full(JOINTS, 0.01)
LAST_VELOCITY = np.array([HOME, pose(0.2)])


def goal(times=TIMES, positions=WAY, names=LIMITS.names, tolerance=TOLERANCE, **rest):
    return Goal(
        Trajectory(names, times, positions, rest.pop('velocities', None)),
        tolerance,
        goal_time=0.0,
        **rest,
    )


BAD = {
    '45 rad': (goal(positions=np.array([HOME, pose(45.0)])), 'look like degrees'),
    'outside': (goal(positions=np.array([HOME, pose(4.0)])), 'position 4 rad is outside'),
    'not finite': (goal(positions=np.array([HOME, pose(np.nan)])), 'is not finite'),
    'no points': (goal(times=np.zeros(0), positions=np.zeros((0, JOINTS))), 'has no points'),
    'times': (goal(times=np.array([0.0, 0.0])), 'times must strictly increase'),
    'too fast': (goal(times=np.array([0.0, 1e-3])), 'rad/s would be needed'),
    'ends moving': (goal(velocities=LAST_VELOCITY), 'must be 0'),
    'start': (goal(positions=np.array([pose(0.3), pose(0.4)])), 'the trajectory starts at 0.3'),
    'names': (goal(names=LIMITS.names[::-1]), 'in its order, are joint_1'),
    'shape': (goal(positions=WAY[:, :4]), r'positions has the shape \(2, 4\), not \(2, 6\)'),
    'tolerance': (goal(tolerance=TOLERANCE[:1]), r'goal_tolerance has the shape \(1,\)'),
    'velocities': (goal(velocities=WAY[:1]), r'velocities has the shape \(1, 6\), not \(2, 6\)'),
}


@pytest.mark.invariant(2)
def test_inv2_the_goal_queue_rejects_what_breaks_a_limit_and_nothing_moves():
    async def check():
        async with cell() as (harness, controller):
            before = controller.joint_position().joints
            for name, (bad, words) in BAD.items():
                submitted = Submitted(bad)
                harness.driver.goal_queue.submit(submitted.handle)
                outcome = await submitted.end()
                assert outcome.end is End.ABORTED, name
                expected = (
                    ErrorCode.INVALID_JOINTS
                    if name in ('names', 'shape', 'tolerance', 'velocities')
                    else ErrorCode.INVALID_GOAL
                )
                assert outcome.code is expected, name
                with pytest.raises(AssertionError, match=words):
                    raise AssertionError(outcome.text)
            assert controller.joint_position().joints == before
            assert harness.gate is None

    run(check())


@pytest.mark.invariant(2)
def test_inv2_a_bad_goal_does_not_replace_the_one_that_runs():
    async def check():
        async with cell() as (harness, _):
            running = harness.submit(pose(0.3))
            await harness.until_moving()
            bad = Submitted(BAD['45 rad'][0])
            harness.driver.goal_queue.submit(bad.handle)
            assert 'look like degrees' in bad.outcome.text
            assert (await running.end()).end is End.SUCCEEDED

    run(check())


def test_a_goal_may_end_moving_where_that_is_allowed():
    async def check():
        async with cell() as (harness, _):
            submitted = Submitted(goal(velocities=LAST_VELOCITY, may_end_moving=True))
            harness.driver.goal_queue.submit(submitted.handle)
            assert (await submitted.end()).end is End.SUCCEEDED

    run(check())
