# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Position streams whose velocities contradict their positions."""

import asyncio

import numpy as np
import pytest
from support.driver_harness import HOME, JOINTS, LIMITS, cell, pose
from support.examples import one_in
from support.streams import PERIOD, positions, sending

from epson_driver.driver.servo.stream import CHECK_MEMORY_S, TRUSTED_AFTER_S, VelocityCheck


def first_contradiction(state_at, duration=2.0, jitter=0.0):
    """Return the time, s, and text of a stream's first contradiction, or (None, None)."""
    check, random = VelocityCheck(LIMITS), np.random.default_rng(0)
    for count in range(round(duration / PERIOD)):
        t = count * PERIOD
        position, velocity = state_at(t)
        text = check.add(t + jitter * random.uniform(-1.0, 1.0), pose(position), pose(velocity))
        if text is not None:
            return t, text
    return None, None


@pytest.mark.parametrize('frequency', [0.1, 0.5, 2.0, 5.0])
def test_sine_with_matching_velocities_and_jitter_is_accepted(frequency):
    omega = 2.0 * np.pi * frequency
    size = min(0.2, 4.0 / omega)
    wave = lambda t: (size * np.sin(omega * t), size * omega * np.cos(omega * t))  # noqa: E731
    assert first_contradiction(wave, jitter=0.008) == (None, None)


def test_jump_with_zero_velocity_is_accepted():
    assert first_contradiction(lambda t: (0.3 if t > 1.0 else 0.0, 0.0)) == (None, None)


@pytest.mark.invariant(2)
@pytest.mark.parametrize('velocity', [0.1, 1.0, 7.0])
def test_inv2_constant_position_with_a_velocity_is_refused_early(velocity):
    time, text = first_contradiction(lambda _: (0.1, velocity))
    assert time <= TRUSTED_AFTER_S + (PERIOD if velocity < 0.5 else 0.0)
    assert 'joint_1: its velocities add up to' in text
    assert 'but its positions move by 0 rad' in text


def test_corrected_stream_is_trusted_again():
    check = VelocityCheck(LIMITS)
    for count in range(20):
        check.add(count * PERIOD, HOME, pose(1.0))
    start = 20 * PERIOD
    texts = [
        check.add(start + count * PERIOD, pose(count * PERIOD), pose(1.0))
        for count in range(round(1.2 * CHECK_MEMORY_S / PERIOD))
    ]
    assert texts[0] is not None
    assert texts[-1] is None
    assert check.trusted


@pytest.mark.invariant(2)
@pytest.mark.parametrize('velocity', one_in(3, [0.3, 1.0, 7.0, 57.3, 10.0, 1e308]))
async def test_inv2_velocities_without_motion_of_positions_do_not_move_the_arm(velocity):
    async with cell(smooth=True) as (harness, _):
        claimed = np.full(JOINTS, velocity)
        async with sending(harness, lambda _: positions(HOME, claimed)):
            await asyncio.sleep(3.0)
            refused = harness.driver.servo.counts.refused
        await asyncio.sleep(2.0)
        positions_seen = np.array([sample.positions for _, sample in harness.events.samples])
        assert np.abs(positions_seen).max() <= 0.04 * min(velocity, LIMITS.velocity.max()) + 1e-3
        assert refused > 100
        assert harness.gate is None
