# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Figures of known motions."""

import numpy as np
import pytest
from support.smoother_harness import LIMITS, NAMES, motion_of

from epson_driver.motion import Trajectory
from epson_driver.report.smooth_study import commanded_rests, measure

TIMES = np.arange(0.0, 4.0005, 0.001)


def pulses(times):
    """Return four moves of 0.5 s, each followed by a rest of 0.5 s."""
    fraction = np.clip(times % 1.0 / 0.5, 0.0, 1.0)
    return times // 1.0 + fraction - np.sin(2 * np.pi * fraction) / (2 * np.pi)


def test_stops_exclude_commanded_rests():
    motion = motion_of(TIMES, lambda times: 0.2 * pulses(times))
    assert measure(motion, None, LIMITS).stops == 3
    moments = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 3.6])
    where = np.array([0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.1, 4.0, 4.0])
    command = Trajectory(NAMES, moments, 0.2 * np.stack([where, 0.0 * where], axis=1))
    assert commanded_rests(command, LIMITS) == 3 - 1  # the third is slow, but no rest
    figures = measure(motion, command, LIMITS)
    assert (figures.stops, figures.commanded_stops) == (1, 2)


def test_reversal_is_no_stop():
    motion = motion_of(TIMES, lambda times: 0.5 * (1 - np.cos(2 * np.pi * times / 4.0 * 2)))
    assert measure(motion, None, LIMITS).stops == 0


def test_figures_are_multiples_of_the_limits():
    motion = motion_of(TIMES, lambda times: np.sin(2.0 * times))
    figures = measure(motion, None, LIMITS)
    assert figures.velocity == pytest.approx(2.0 / 8.0, rel=1e-3)
    assert figures.acceleration == pytest.approx(4.0 / 50.0, rel=1e-2)
    assert figures.duration == pytest.approx(4.0)


def test_plan_at_one_position_has_no_intermediate_rests():
    command = Trajectory(NAMES, np.array([0.0, 1.0, 2.0]), np.full((3, 2), 0.3))
    assert commanded_rests(command, LIMITS) == 0
