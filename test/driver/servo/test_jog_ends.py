# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A jog that ends, however it ends: on every controller the arm stands as after STOP alone.

Times are virtual; `pytest -rP -m '' -k as_stop_does test/driver/servo/test_jog_ends.py` prints the
figures of docs/servo.md.
"""

import asyncio

import pytest
from support.driver_harness import HOME, cell, pose
from support.event_loop import now, run, until
from support.streams import going_on, jogging, send, velocities

from epson_driver.driver.outcome import End

RELEASED = velocities(HOME)
SPEED = 1.5
"""rad/s, nearly all that servo.scale leaves."""

JOG_PERIOD_S = 0.025
"""Of the panel, while a button is held."""

WITHIN_S = 0.15
"""What the end of a jog may take beyond the controller's own braking."""

STANDS = 1e-4
"""An arm that is so near to where it comes to rest, rad, stands."""

PHASES = (0.003, 0.061, 0.171, 0.327)
"""How much longer than a whole number of periods a jog lasts, s: an arm that goes from point to
point may stand just then."""


def held(_time):
    return velocities(pose(SPEED))


async def let_go(harness):
    harness.driver.servo.take(RELEASED)


async def silent(_harness):
    pass


async def stopped(harness):
    await harness.commands.stop()


ENDS = {'STOP': stopped, 'released': let_go, 'silent': silent}


async def to_rest(controller, phase, end):
    """Return how long the arm still moved after the end of a jog, s."""
    async with jogging(*controller) as harness:
        async with going_on(harness, held, JOG_PERIOD_S):
            await asyncio.sleep(1.2 + phase)
        ended, before = now(), len(harness.events.samples)
        ending = asyncio.create_task(end(harness))
        await asyncio.sleep(2.0)
        await ending
        ways = [(each.measured, each.positions[0]) for _, each in harness.events.samples]
        there = ways[-1][1]
        assert ways[before][1] - ways[0][1] > 0.01
        assert harness.gate is None
        return max(time for time, way in ways if abs(way - there) > STANDS) - ended


CONTROLLERS = [
    ('simulated', True),
    *((name, False) for name in ('simulated', 'generic', 'fanuc', 'spel')),
]
"""Profiles that follow streams, and whether the arm moves smoothly."""


@pytest.mark.slow
@pytest.mark.invariant(3)
@pytest.mark.parametrize('controller', CONTROLLERS, ids=lambda row: row[0] + ' smooth' * row[1])
def test_a_jog_that_ends_leaves_the_arm_at_rest_as_stop_does(controller):
    took = {how: [] for how in ENDS}

    async def measure(phase):
        for how, end in ENDS.items():
            took[how].append(await to_rest(controller, phase, end))

    for phase in PHASES:
        run(measure(phase))
    for how, times in took.items():
        print(f'{how}: {1e3 * min(times):.0f} to {1e3 * max(times):.0f} ms')
    for how, times in took.items():
        assert max(times) < max(took['STOP']) + WITHIN_S, how


@pytest.mark.parametrize('smooth', [True, False], ids=['smooth', 'point to point'])
async def test_a_key_that_is_pressed_anew_moves_the_arm_as_soon_as_it_stands(smooth):
    async with cell(smooth=smooth) as (harness, _):
        await send(harness, held, 0.6)
        await let_go(harness)
        pressed = now()
        async with going_on(harness, lambda _: velocities(pose(-SPEED))):
            await until(lambda: harness.driver.robot.sample.velocities[0] < -0.01)
        assert now() - pressed < 1.0
        assert not harness.driver.servo.blocked(now())
        assert harness.gate is None


async def test_a_goal_runs_as_soon_as_the_arm_stands_after_a_jog():
    async with cell() as (harness, _):
        await send(harness, held, 0.6)
        await let_go(harness)
        assert 'follows a stream' in harness.driver.servo.occupation()
        await until(lambda: harness.driver.servo.occupation() is None)
        assert await harness.rests()
        assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED


@pytest.mark.invariant(4)
async def test_inv4_a_stop_while_a_released_key_has_the_arm_brake_counts():
    async with cell(smooth=True) as (harness, _):
        async with going_on(harness, held):
            await asyncio.sleep(0.6)
            await let_go(harness)
            await harness.commands.stop()
            at = harness.at
            await asyncio.sleep(2.0)
            assert abs(harness.at - at).max() < STANDS
        assert not harness.driver.servo.active


async def test_a_stick_at_rest_sends_no_stop():
    async with cell(smooth=True) as (harness, _):
        await send(harness, held, 0.3)
        await let_go(harness)
        await until(lambda: not harness.driver.servo.active)
        frames = harness.driver.motion_link.statistics.frames_sent
        await send(harness, lambda _: RELEASED, 0.5)
        assert harness.driver.motion_link.statistics.frames_sent == frames
