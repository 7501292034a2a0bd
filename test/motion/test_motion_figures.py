# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The figures of motions that are known."""

import numpy as np
import pytest
from support.motion_harness import LIMITS, NAMES, motion_of

from epson_driver.motion import Trajectory
from epson_driver.motion.motion_figures import commanded_rests, measure

TIMES = np.arange(0.0, 4.0005, 0.001)


def pulses(times):
    """Four moves with a rest between, each half of its second long."""
    share = np.clip(times % 1.0 / 0.5, 0.0, 1.0)
    return times // 1.0 + share - np.sin(2 * np.pi * share) / (2 * np.pi)


def test_stops_are_counted_and_those_that_were_commanded_told_apart():
    motion = motion_of(TIMES, lambda times: 0.2 * pulses(times))
    assert measure(motion, None, LIMITS).stops == 3
    at = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 3.6])
    where = np.array([0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.1, 4.0, 4.0])
    command = Trajectory(NAMES, at, 0.2 * np.stack([where, 0.0 * where], axis=1))
    assert commanded_rests(command, LIMITS) == 3 - 1  # the third is slow, but no rest
    figures = measure(motion, command, LIMITS)
    assert (figures.stops, figures.commanded_stops) == (1, 2)


def test_turning_round_is_no_stop():
    motion = motion_of(TIMES, lambda times: 0.5 * (1 - np.cos(2 * np.pi * times / 4.0 * 2)))
    assert measure(motion, None, LIMITS).stops == 0


def test_multiples_of_the_limits():
    motion = motion_of(TIMES, lambda times: np.sin(2.0 * times))
    figures = measure(motion, None, LIMITS)
    assert figures.velocity == pytest.approx(2.0 / 8.0, rel=1e-3)
    assert figures.acceleration == pytest.approx(4.0 / 50.0, rel=1e-2)
    assert figures.duration == pytest.approx(4.0)


def test_a_plan_that_stays_where_it_is_has_no_rests_between():
    command = Trajectory(NAMES, np.array([0.0, 1.0, 2.0]), np.full((3, 2), 0.3))
    assert commanded_rests(command, LIMITS) == 0
