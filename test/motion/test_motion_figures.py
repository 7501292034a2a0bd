# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Figures of known motions, and the places and times at which they pass waypoints."""

import numpy as np
import pytest
from support.smoother_harness import CURVE, LIMITS, NAMES, PLAN, motion_of

from epson_driver.motion import Trajectory
from epson_driver.motion import closest_samples as passages_module
from epson_driver.motion.closest_samples import (
    closest_sample_indices,
    commanded_rests,
    measure,
    passed,
)
from epson_driver.motion.smoothed import smoothed

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


def test_passages_are_found_between_samples_in_order():
    times = np.arange(0.0, 2.005, 0.01)
    motion = motion_of(times, lambda times: np.sin(np.pi * times))  # up, down, and up again
    a = [0.0, 0.5, 1.0, 0.5, -1.0, 0.0]
    waypoints = np.stack([a, [0.0, 0.0, 0.0, 0.0, 0.1, 0.0]], axis=1)
    errors, when = passed(waypoints, motion)
    expected = np.array([0.0, 1 / 6, 0.5, 5 / 6, 1.5, 2.0])
    assert np.abs(when - expected)[[0, 1, 2, 3, 5]].max() < 0.02
    assert abs(when[4] - 1.5) < 0.15  # 0.1 rad away during that time
    assert errors[[0, 1, 2, 3, 5]].max() < 1e-4
    assert errors[4] == pytest.approx(0.1)
    assert closest_sample_indices(waypoints, motion.positions)[0] == 0


def test_sparse_search_of_long_motions_gives_the_same_result(monkeypatch):
    motion = smoothed(PLAN, LIMITS, period=0.001)
    expected = passed(CURVE, motion)
    monkeypatch.setattr(passages_module, 'MAX_COMPARED_PAIRS', 1000)
    errors, times = passed(CURVE, motion)
    assert errors == pytest.approx(expected[0])
    assert times == pytest.approx(expected[1])
