# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An arm left behind by a stream catches up on the stream's path at a limited speed."""

import asyncio
import logging
from itertools import product

import numpy as np
import pytest
from support.driver_harness import cell
from support.event_loop import now, stand_still
from support.examples import one_in
from support.streams import positions, window

from epson_driver.driver.servo.servo import LEFT_BEHIND_S

PACE = np.array([0.2, 0.12, -0.08, 0.05, 0.1, -0.2])
"""rad/s: a slow plan with a different speed for each joint."""

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


async def followed(harness, stream, *, stalled_driver):
    """Send a stream with a pause of the sender or a stall of this process."""
    start = now()
    stalls = start + 1.5
    while now() - start < MOVES_S + 2.0:
        if stalled_driver and now() >= stalls:
            stand_still(STALL_S)
            stalls = np.inf
        if stalled_driver or not stalls < now() < stalls + STALL_S:
            harness.driver.servo.take(stream(now() - start))
        await asyncio.sleep(PERIOD_S)
    samples = [sample for _, sample in harness.events.samples]
    positions = np.array([sample.positions for sample in samples])
    along = PACE / np.linalg.norm(PACE)
    deviation = np.abs(positions - np.outer(positions @ along, along)).max()
    speed_ratio = np.abs(np.array([sample.velocities for sample in samples]) / PACE).max()
    assert harness.at == pytest.approx(PACE * MOVES_S, abs=1e-3)
    return deviation, speed_ratio


@pytest.mark.slow
@pytest.mark.parametrize(('stream', 'stalled_driver'), [*product(STREAMS, [False, True])])
async def test_catch_up_factor_limits_the_speed_after_a_stall(stream, stalled_driver, caplog):
    caplog.set_level(logging.WARNING)

    async with cell(smooth=True) as (harness, _):
        catch_up = harness.driver.servo.settings.catch_up
        assert catch_up == 1.5
        deviation, speed_ratio = await followed(
            harness, STREAMS[stream], stalled_driver=stalled_driver
        )
        assert speed_ratio < 1.03 * catch_up
        assert deviation < 0.012  # rad (0.04 without the bound)
        left_behind = harness.driver.servo.counts.left_behind
        assert left_behind > (LEFT_BEHIND_S / PERIOD_S) / 2.0
    (line,) = [line for line in caplog.messages if 'catches up at no more than' in line]
    assert '1.5 times the speed of the stream (servo.catch_up)' in line


PLAN = np.array([0.3, 0.15, -0.2, 0.1, 0.15, -0.3])
"""rad: a displacement in MOVES_S that starts and ends at rest."""

STALLS = ((2.5, 0.6), (3.3, 0.5))
"""Pauses of the sender: start and duration, s."""


def planned(time):
    x = min(max(time / MOVES_S, 0.0), 1.0)
    share, rate = x**3 * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * x**2 * (1.0 - x) ** 2
    return PLAN * share, PLAN * rate / MOVES_S


@pytest.mark.slow
@pytest.mark.parametrize('shape', one_in(2, ['windows', 'positions']))
async def test_two_stalls_before_the_end_are_caught_up_at_limited_speed(shape):
    async with cell(smooth=True) as (harness, _):
        start = now()
        while (time := now() - start) < MOVES_S + 2.0:
            if not any(begin <= time < begin + pause for begin, pause in STALLS):
                harness.driver.servo.take(
                    positions(planned(time)[0])
                    if shape == 'positions'
                    else window(lambda ahead, time=time: planned(time + ahead))
                )
            await asyncio.sleep(PERIOD_S)
        samples = [sample for _, sample in harness.events.samples]
        far = [np.abs(sample.positions - PLAN).max() > 1e-3 for sample in samples]
        arrived = max(
            sample.measured for sample, is_far in zip(samples, far, strict=True) if is_far
        )
        assert arrived - start - MOVES_S < 3.0 * STALLS[-1][1]
        later = [sample for sample in samples if sample.measured > start + STALLS[0][0]]
        fastest = np.abs([sample.velocities for sample in later]).max(axis=0)
        own = np.abs(planned(STALLS[0][0])[1])
        assert (fastest / own).max() < 1.05 * harness.driver.servo.settings.catch_up
