# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A lower speed requested by a Python program slows the arm or is rejected."""

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.driver_harness import LIMITS
from support.event_loop import now, run
from support.examples import quickly
from support.fault_play import where

from epson_driver.aio import RobotError
from epson_driver.share import share_path

FILES = share_path('config', 'controllers').glob('*.yaml')
PROFILES = sorted(path.stem for path in FILES)
TARGET = [0.15, 0.0, 0.0, 0.0, 0.0, 0.0]
WINDOW_S = 0.1
REASONS = (
    'override of its pendant',
    'over Remote Ethernet alone',
    'the minimum of the controller',
)
"""Parts of the errors of a rejection."""


def record(controller):
    """Record times and positions of the arm in the returned lists."""
    times, positions = [now()], [where(controller)]
    step = controller.step

    def recorded(seconds):
        step(seconds)
        times.append(times[-1] + seconds)
        positions.append(where(controller))

    controller.step = recorded
    return times, positions


def peak(times, positions):
    """Return the highest mean speed over WINDOW_S, rad/s."""
    times, positions = np.array(times), np.array(positions)
    ends = np.searchsorted(times, times + WINDOW_S)
    inside = np.flatnonzero(ends < len(times))
    return float(np.abs(positions[ends[inside]] - positions[inside]).max(initial=0.0) / WINDOW_S)


def time_in_motion(times, positions):
    """Return the time from the arm's first to its last movement, s."""
    moving = np.flatnonzero(np.abs(np.diff(positions, axis=0)).max(axis=1) > 1e-6)
    return times[moving[-1] + 1] - times[moving[0]]


async def moved(profile, scaling=1.0, **fractions):
    """Return a move's peak speed and time in motion, or None if it was rejected."""
    async with robot_cell(profile=profile, smooth=profile != 'spel') as (robot, controller):
        recorded = record(controller)
        try:
            if scaling != 1.0:
                robot.set_speed_scaling(scaling)
            motion = await robot.move_joints(TARGET, **fractions)
        except RobotError as error:
            refused = str(error)
        else:
            refused = ''
        if refused:
            assert any(reason in refused for reason in REASONS), refused
            assert peak(*recorded) == 0.0
            return None
        assert np.abs(robot.joints - TARGET).max() < 0.01, motion.text
        return peak(*recorded), time_in_motion(*recorded)


@pytest.mark.invariant(10)
@pytest.mark.parametrize('profile', quickly(('simulated', 'fanuc'), PROFILES, several=False))
def test_inv10_speed_fraction_slows_the_arm_or_is_rejected(profile):
    async def scenario():
        usual = await moved(profile, speed=0.1, acceleration=0.5)
        slow = [await moved(profile, speed=0.01, acceleration=0.5)]
        slow.append(await moved(profile, scaling=0.1, speed=0.1, acceleration=0.5))
        assert usual is not None or profile == 'fanuc'
        for result in slow:
            assert result is None or result[0] <= 0.015 * LIMITS.velocity[0]
        gentle = await moved(profile, speed=0.1, acceleration=0.01)
        assert gentle is None or gentle[1] > 1.5 * usual[1]

    run(scenario(), patience=3600.0)
