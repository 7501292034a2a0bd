# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Where nothing is wrong nothing ends with a closed gate, whatever is asked for and when."""

import asyncio

import numpy as np
import pytest
from support.driver_harness import JOINTS, LIMITS, Submitted, cell, pose
from support.event_loop import now, run, until
from support.examples import one_in
from support.fault_free_play import Play
from support.streams import velocities

from epson_driver.driver.goal.goal import Goal
from epson_driver.driver.outcome import End
from epson_driver.motion import Trajectory

SEQUENCES, BLOCK, SLOW_BLOCKS = 2000, 4, 75
"""How many are played, so many one after the other with the same arm."""

LONGEST = 300.0
"""How long a sequence may take to come to its end, s: a long segment may be as slow as 0.01."""

pytestmark = pytest.mark.invariant(5)


def scale(harness, factor):
    harness.driver.goal_queue.set_speed(factor)


def submit(harness, times, positions, goal_time=0.0):
    trajectory = Trajectory(LIMITS.names, np.array(times), np.array(positions))
    submitted = Submitted(Goal(trajectory, np.full(JOINTS, 0.01), goal_time))
    harness.driver.goal_queue.submit(submitted.handle)
    return submitted


async def succeeds(harness, goal):
    outcome = await goal.end()
    assert outcome.end is End.SUCCEEDED, outcome.text
    assert harness.gate is None
    assert np.abs(harness.at - goal.handle.goal.trajectory.positions[-1]).max() < 0.01
    return outcome


# --- as slow as a point was sent ---------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize('factor', [0.1, 0.01])
async def test_a_goal_that_begins_at_a_small_factor_succeeds_when_the_arm_is_there(factor):
    """The point is sent with the smallest velocity that there is, and the clock knows."""
    async with cell() as (harness, _):
        scale(harness, factor)
        await asyncio.sleep(0.02)
        goal = harness.submit(pose(0.1), step=1.5)
        began = now()
        await asyncio.sleep(0.1)
        scale(harness, 1.0)
        await succeeds(harness, goal)
        assert now() - began < 14.0


@pytest.mark.slow
async def test_a_goal_that_is_slow_for_a_moment_succeeds_after_a_stream():
    async with cell() as (harness, _):
        harness.driver.servo.take(velocities([0.2, *[0.0] * (JOINTS - 1)]))
        await asyncio.sleep(0.9)
        goal = harness.submit(harness.at + pose(0.1), step=2.0)
        for factor in (0.01, 1.0):
            await asyncio.sleep(0.01)
            scale(harness, factor)
        await succeeds(harness, goal)


@pytest.mark.slow
async def test_a_goal_after_canceled_ones_with_slow_points_succeeds():
    """The next point waits, as those before it are slow: no reply is missing then."""
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


# --- as long as the plan rests -----------------------------------------------------------------


@pytest.mark.parametrize('smooth', one_in(2, [False, True]))
@pytest.mark.parametrize('rest', one_in(2, [[7.0], [0.5] * 14]), ids=['one segment', 'many'])
async def test_a_plan_that_rests_for_longer_than_the_patience_succeeds(smooth, rest):
    async with cell(smooth=smooth) as (harness, _):
        began = now()
        times = np.cumsum([0.0, 0.3, *rest, 0.2])
        ways = [pose(), *[pose(0.1)] * (1 + len(rest)), pose(0.2)]
        await succeeds(harness, submit(harness, times, ways))
        assert now() - began > times[-1]


async def test_a_plan_that_ends_with_a_long_rest_succeeds():
    async with cell() as (harness, _):
        ways = [pose(), pose(0.1), pose(0.1)]
        await succeeds(harness, submit(harness, [0.0, 0.3, 7.3], ways))


# --- in any order ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    'block',
    [
        pytest.param(block, marks=pytest.mark.slow if block < SLOW_BLOCKS else pytest.mark.soak)
        for block in range(SEQUENCES // BLOCK)
    ],
)
def test_inv5_whatever_is_asked_for_the_gate_stays_open_and_the_next_goal_succeeds(block):
    """docs/invariants.md, 5."""

    async def check():
        async with cell(smooth=bool(block % 2)) as (harness, controller):
            for number in range(BLOCK):
                play = Play(harness, controller, np.random.default_rng([block, number]))
                async with asyncio.timeout(LONGEST):
                    await play.go_on()
                    await play.end()
                    await until(lambda: not harness.driver.busy and harness.driver.goal_queue.idle)
                assert harness.gate is None, play
                assert await harness.rests(), play
                assert all(len(goal.outcomes) == 1 for goal in play.goals), play
                await succeeds(harness, play.submit(0.1))

    run(check(), patience=BLOCK * LONGEST)
