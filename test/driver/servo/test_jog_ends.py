# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every end of a jog brings the arm to rest about as fast as STOP, on every controller.

Times are virtual. `pytest -rP -m '' -k as_fast_as_stop test/driver/servo/test_jog_ends.py` prints
the figures of docs/servo.md.
"""

import asyncio

import pytest
from support.driver_harness import HOME, cell, pose
from support.event_loop import now, run, until
from support.streams import jogging, send, sending, velocities

from epson_driver.driver.outcome import End

RELEASED = velocities(HOME)
SPEED = 1.5
"""rad/s, nearly the limit of servo.scale."""

JOG_PERIOD_S = 0.025
"""Setpoint period of the panel while a button is pressed."""

WITHIN_S = 0.15
"""Maximum extra time of a jog's end over STOP."""

AT_REST = 1e-4
"""Maximum distance of an arm at rest from its final position, rad."""

PHASES = (0.003, 0.061, 0.171, 0.327)
"""Extra durations of the jog, s, because a point-to-point arm may be at rest at full periods."""


def held(_time):
    return velocities(pose(SPEED))


async def release(harness):
    harness.driver.servo.take(RELEASED)


async def silent(_harness):
    pass


async def stopped(harness):
    await harness.commands.stop()


ENDS = {'STOP': stopped, 'released': release, 'silent': silent}


async def to_rest(controller, phase, end):
    """Return how long the arm moves after the end of a jog, s."""
    async with jogging(*controller) as harness:
        async with sending(harness, held, JOG_PERIOD_S):
            await asyncio.sleep(1.2 + phase)
        ended, before = now(), len(harness.events.samples)
        ending = asyncio.create_task(end(harness))
        await asyncio.sleep(2.0)
        await ending
        path = [(sample.measured, sample.positions[0]) for _, sample in harness.events.samples]
        end_position = path[-1][1]
        assert path[before][1] - path[0][1] > 0.01
        assert harness.gate is None
        return max(time for time, at in path if abs(at - end_position) > AT_REST) - ended


CONTROLLERS = [
    ('simulated', True),
    ('spel', False),
    *(
        pytest.param((name, False), marks=pytest.mark.soak)
        for name in ('simulated', 'generic', 'fanuc')
    ),
]
"""Profiles that accept streams, and whether the arm moves smoothly."""


@pytest.mark.slow
@pytest.mark.invariant(3)
@pytest.mark.parametrize('controller', CONTROLLERS, ids=lambda row: row[0] + ' smooth' * row[1])
def test_jog_ends_as_fast_as_stop(controller):
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
async def test_key_pressed_again_moves_the_arm_without_a_pause(smooth):
    async with cell(smooth=smooth) as (harness, _):
        await send(harness, held, 0.6)
        await release(harness)
        pressed = now()
        async with sending(harness, lambda _: velocities(pose(-SPEED))):
            await until(lambda: harness.driver.robot.sample.velocities[0] < -0.01)
        assert now() - pressed < 1.0
        assert not harness.driver.servo.blocked(now())
        assert harness.gate is None


async def test_goal_runs_as_soon_as_the_arm_rests_after_a_jog():
    async with cell() as (harness, _):
        await send(harness, held, 0.6)
        await release(harness)
        assert 'follows a stream' in harness.driver.servo.active_user()
        await until(lambda: harness.driver.servo.active_user() is None)
        assert await harness.rests()
        assert (await harness.submit(pose(0.1)).end()).end is End.SUCCEEDED


@pytest.mark.invariant(4)
async def test_inv4_stop_while_a_released_jog_brakes_blocks_the_stream():
    async with cell(smooth=True) as (harness, _):
        async with sending(harness, held):
            await asyncio.sleep(0.6)
            await release(harness)
            await harness.commands.stop()
            at = harness.at
            await asyncio.sleep(2.0)
            assert abs(harness.at - at).max() < AT_REST
        assert not harness.driver.servo.active


async def test_released_joystick_sends_no_stop():
    async with cell(smooth=True) as (harness, _):
        await send(harness, held, 0.3)
        await release(harness)
        await until(lambda: not harness.driver.servo.active)
        frames = harness.driver.motion_link.statistics.frames_sent
        await send(harness, lambda _: RELEASED, 0.5)
        assert harness.driver.motion_link.statistics.frames_sent == frames
