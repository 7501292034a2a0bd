# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Positions of a stream that do not move as the velocities beside them say."""

import asyncio

import numpy as np
import pytest
from support.driver_harness import HOME, JOINTS, LIMITS, cell, pose
from support.examples import one_in
from support.streams import PERIOD, going_on, positions

from epson_driver.driver.servo.stream import CHECK_MEMORY_S, TRUSTED_AFTER_S, VelocityCheck


def first_said(state_at, duration=2.0, jitter=0.0):
    """Return when a stream was first contradictory, s, or None, and what was said."""
    check, random = VelocityCheck(LIMITS), np.random.default_rng(0)
    for count in range(round(duration / PERIOD)):
        t = count * PERIOD
        position, velocity = state_at(t)
        said = check.add(t + jitter * random.uniform(-1.0, 1.0), pose(position), pose(velocity))
        if said is not None:
            return t, said
    return None, None


@pytest.mark.parametrize('frequency', [0.1, 0.5, 2.0, 5.0])
def test_a_sine_with_its_velocities_agrees_however_it_jitters(frequency):
    omega = 2.0 * np.pi * frequency
    size = min(0.2, 4.0 / omega)
    wave = lambda t: (size * np.sin(omega * t), size * omega * np.cos(omega * t))  # noqa: E731
    assert first_said(wave, jitter=0.008) == (None, None)


def test_positions_that_jump_are_not_contradictory():
    assert first_said(lambda t: (0.3 if t > 1.0 else 0.0, 0.0)) == (None, None)


@pytest.mark.invariant(2)
@pytest.mark.parametrize('velocity', [0.1, 1.0, 7.0])
def test_inv2_a_hold_with_a_velocity_is_refused_before_it_counts_in_full(velocity):
    when, said = first_said(lambda _: (0.1, velocity))
    assert when <= TRUSTED_AFTER_S + (PERIOD if velocity < 0.5 else 0.0)
    assert 'joint_1: its velocities lead by' in said
    assert 'where its positions move by 0 rad' in said


def test_a_stream_that_agrees_again_is_trusted_again():
    check = VelocityCheck(LIMITS)
    for count in range(20):
        check.add(count * PERIOD, HOME, pose(1.0))
    begin = 20 * PERIOD
    said = [
        check.add(begin + count * PERIOD, pose(count * PERIOD), pose(1.0))
        for count in range(round(1.2 * CHECK_MEMORY_S / PERIOD))
    ]
    assert said[0] is not None
    assert said[-1] is None
    assert check.trusted


@pytest.mark.invariant(2)
@pytest.mark.parametrize('velocity', one_in(3, [0.3, 1.0, 7.0, 57.3, 10.0, 1e308]))
async def test_inv2_velocities_that_no_position_bears_out_lead_nowhere(velocity):
    """What went 0.1 to 0.45 rad away from positions of 0."""
    async with cell(smooth=True) as (harness, _):
        claimed = np.full(JOINTS, velocity)
        async with going_on(harness, lambda _: positions(HOME, claimed)):
            await asyncio.sleep(3.0)
            refused = harness.driver.servo.counts.refused
        await asyncio.sleep(2.0)
        ways = np.array([sample.positions for _, sample in harness.events.samples])
        assert np.abs(ways).max() <= 0.04 * min(velocity, LIMITS.velocity.max()) + 1e-3
        assert refused > 100
        assert harness.gate is None
