# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An arm that was left behind by a stream comes after it at the stream's own pace, on its line."""

import asyncio
import logging
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from support.driver_harness import cell
from support.event_loop import now, stand_still
from support.streams import positions, window

from epson_driver.driver.servo.servo import LEFT_BEHIND_S

PACE = np.array([0.2, 0.12, -0.08, 0.05, 0.1, -0.2])
"""rad/s: a slow plan, with each joint at a speed of its own."""

MOVES_S = 4.0
STALL_S = 0.6
PERIOD_S = 0.01


def state(time):
    return PACE * min(time, MOVES_S), PACE * (time < MOVES_S)


STREAMS = {
    'positions': lambda time: positions(state(time)[0]),
    'positions with velocities': lambda time: positions(*state(time)),
    'windows': lambda time: window(lambda ahead: state(time + ahead)),
}


async def followed(harness, stream, *, held):
    """Send a stream that stalls: at the sender, or as this process is held up."""
    begin = now()
    stalls = begin + 1.5
    while now() - begin < MOVES_S + 2.0:
        if held and now() >= stalls:
            stand_still(STALL_S)
            stalls = np.inf
        if held or not stalls < now() < stalls + STALL_S:
            harness.driver.servo.take(stream(now() - begin))
        await asyncio.sleep(PERIOD_S)
    samples = [sample for _, sample in harness.events.samples]
    ways = np.array([sample.positions for sample in samples])
    along = PACE / np.linalg.norm(PACE)
    beside = np.abs(ways - np.outer(ways @ along, along)).max()
    faster = np.abs(np.array([each.velocities for each in samples]) / PACE).max()
    assert harness.at == pytest.approx(PACE * MOVES_S, abs=1e-3)
    return beside, faster


@pytest.mark.slow
@pytest.mark.parametrize(('stream', 'held'), [*product(STREAMS, [False, True])])
async def test_after_a_stall_the_arm_is_not_much_faster_than_its_stream(stream, held, caplog):
    caplog.set_level(logging.WARNING)

    async with cell(smooth=True) as (harness, _):
        catch_up = harness.driver.servo.settings.catch_up
        assert catch_up == 1.5
        beside, faster = await followed(harness, STREAMS[stream], held=held)
        assert faster < 1.03 * catch_up
        assert beside < 0.012  # rad; 0.04 without the bound
        left_behind = harness.driver.servo.counts.left_behind
        assert left_behind > (LEFT_BEHIND_S / PERIOD_S) / 2.0
    (line,) = [each for each in caplog.messages if 'left the arm' in each]
    assert '1.5 times as fast as it goes itself (servo.catch_up)' in line


@pytest.mark.slow
async def test_a_stream_that_does_not_stall_leaves_nobody_behind(caplog):
    async with cell(smooth=True) as (harness, _):
        begin = now()
        while (time := now() - begin) < 2.0:
            harness.driver.servo.take(positions(*state(time)))
            await asyncio.sleep(PERIOD_S)
        assert harness.driver.servo.counts.left_behind == 0
    assert not [each for each in caplog.messages if 'left the arm' in each]


@pytest.mark.slow
async def test_who_wants_it_faster_says_so():
    async with cell(smooth=True) as (harness, _):
        servo = harness.driver.servo
        servo.settings = replace(servo.settings, catch_up=4.0)
        _, faster = await followed(harness, STREAMS['positions'], held=False)
        assert 2.0 < faster < 4.2
