# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Without a fault, the gate stays open after any sequence of requests."""

import asyncio

import numpy as np
import pytest
from support.driver_harness import JOINTS, LIMITS, cell, pose
from support.event_loop import now, run, until
from support.examples import one_in
from support.fault_free_play import Play
from support.streams import velocities

from epson_driver.driver.outcome import End
from epson_driver.motion import Trajectory

SEQUENCES, BLOCK, SLOW_BLOCKS = 2000, 4, 6
"""Number of sequences, of sequences played with one arm, and of blocks in the slow tests."""

LONGEST = 300.0
"""Maximum duration of a sequence, s: a long segment may run at a factor of 0.01."""

pytestmark = pytest.mark.invariant(5)


def scale(harness, factor):
    harness.driver.goal_queue.set_speed(factor)


def submit(harness, times, positions, goal_time=0.0):
    trajectory = Trajectory(LIMITS.names, np.array(times), np.array(positions))
    return harness.execute(trajectory, goal_time=goal_time)


async def succeeds(harness, goal):
    outcome = await goal.end()
    assert outcome.end is End.SUCCEEDED, outcome.text
    assert harness.gate is None
    assert np.abs(harness.at - goal.handle.goal.trajectory.positions[-1]).max() < 0.01
    return outcome


# --- slow points ---------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize('factor', [0.1, 0.01])
async def test_goal_started_at_a_small_speed_factor_succeeds_on_arrival(factor):
    """The first point has the minimum velocity, which the goal's clock takes into account."""
    async with cell() as (harness, _):
        scale(harness, factor)
        await asyncio.sleep(0.02)
        goal = harness.submit(pose(0.1), step=1.5)
        start = now()
        await asyncio.sleep(0.1)
        scale(harness, 1.0)
        await succeeds(harness, goal)
        assert now() - start < 14.0


@pytest.mark.slow
async def test_briefly_slow_goal_succeeds_after_a_stream():
    async with cell() as (harness, _):
        harness.driver.servo.take(velocities([0.2, *[0.0] * (JOINTS - 1)]))
        await asyncio.sleep(0.9)
        goal = harness.submit(harness.at + pose(0.1), step=2.0)
        for factor in (0.01, 1.0):
            await asyncio.sleep(0.01)
            scale(harness, factor)
        await succeeds(harness, goal)


@pytest.mark.slow
async def test_goal_after_canceled_goals_with_slow_points_succeeds():
    """The next point waits for the slow ones, so a missing reply is not a fault."""
    first = [0.1914, -0.0509, -0.2106, 0.226, 0.2207, 0.1201]
    back = [0.1197, -0.0353, 0.0287, 0.3654, 0.011, -0.0386]
    second = [-0.1958, 0.0626, 0.232, 0.2333, 0.0756, 0.1911]
    third = [0.0585, 0.1222, -0.0755, -0.1307, -0.0622, -0.0254]

    async with cell(smooth=True) as (harness, _):
        scale(harness, 0.3)
        await asyncio.sleep(0.01)
        canceled = submit(harness, [0.0, 0.213, 0.426], [pose(), first, back], goal_time=3.0)
        scale(harness, 0.01)
        await asyncio.sleep(0.01)
        harness.driver.goal_queue.cancel(canceled.handle)
        submit(harness, [1.1141], [second])
        goal = submit(harness, [0.0, 1.5152], [pose(), third], goal_time=3.0)
        await asyncio.sleep(0.311)
        scale(harness, 1.0)
        await succeeds(harness, goal)


# --- plans with a rest -----------------------------------------------------------------


@pytest.mark.parametrize('smooth', one_in(2, [False, True]))
@pytest.mark.parametrize('rest', one_in(2, [[7.0], [0.5] * 14]), ids=['one segment', 'many'])
async def test_plan_with_a_long_rest_succeeds(smooth, rest):
    async with cell(smooth=smooth) as (harness, _):
        start = now()
        times = np.cumsum([0.0, 0.3, *rest, 0.2])
        path = [pose(), *[pose(0.1)] * (1 + len(rest)), pose(0.2)]
        await succeeds(harness, submit(harness, times, path))
        assert now() - start > times[-1]


@pytest.mark.slow
async def test_plan_that_ends_with_a_long_rest_succeeds():
    async with cell() as (harness, _):
        path = [pose(), pose(0.1), pose(0.1)]
        await succeeds(harness, submit(harness, [0.0, 0.3, 7.3], path))


# --- random sequences ------------------------------------------------------------


@pytest.mark.parametrize(
    'block',
    [
        pytest.param(block, marks=pytest.mark.slow if block < SLOW_BLOCKS else pytest.mark.soak)
        for block in range(SEQUENCES // BLOCK)
    ],
)
def test_inv5_random_requests_keep_the_gate_open_and_the_next_goal_succeeds(block):
    async def check():
        async with cell(smooth=bool(block % 2)) as (harness, controller):
            for number in range(BLOCK):
                play = Play(harness, controller, np.random.default_rng([block, number]))
                async with asyncio.timeout(LONGEST):
                    await play.act()
                    await play.end()
                    await until(lambda: not harness.driver.busy and harness.driver.goal_queue.idle)
                assert harness.gate is None, play
                assert await harness.rests(), play
                assert all(len(goal.outcomes) == 1 for goal in play.goals), play
                await succeeds(harness, play.submit(0.1))

    run(check(), patience=BLOCK * LONGEST)
