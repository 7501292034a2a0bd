# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From waypoints to a smooth motion in one call."""

from typing import Any

import numpy as np
import pytest
from support.smoother_harness import CURVE, LIMITS, PLAN

from epson_driver.motion import smooth
from epson_driver.motion.smoothed import every, smoothed
from epson_driver.motion.smoother import Mode


@pytest.mark.parametrize('mode', Mode)
def test_smooth_returns_the_smoother_s_motion(mode: Mode) -> None:
    times = PLAN.times if mode is Mode.TIME_PRESERVING else None
    motion = smooth(CURVE.tolist(), LIMITS, times, period=0.01)
    same = smoothed(PLAN, LIMITS, mode, period=0.01)
    assert np.array_equal(motion.positions, same.positions)
    assert np.array_equal(motion.times, same.times)


@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    ('waypoints', 'times', 'expected'),
    [
        (CURVE[:, :1], None, r'waypoints have the shape .*: must be \(k, '),
        (CURVE[0], None, r'waypoints have the shape'),
        (CURVE, [0.0, 1.0], r'times have the shape \(2,\): must be'),
        (CURVE + np.nan, None, r'point 0, .* = nan .*; and \d+ more'),
        (CURVE + 100.0, None, r'point 0, .* is outside the limits'),
        (CURVE, np.zeros(len(CURVE)), r'times must strictly increase'),
    ],
)
def test_invalid_waypoints_are_rejected(waypoints: Any, times: Any, expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        smooth(waypoints, LIMITS, times)


def test_plan_beyond_the_limits_takes_longer() -> None:
    assert smooth(CURVE, LIMITS, PLAN.times / 100).duration > PLAN.duration / 10


def test_every_keeps_both_ends() -> None:
    motion = smoothed(PLAN, LIMITS)
    some = every(motion, 3)
    assert np.array_equal(some.positions[:-1], motion.positions[::3][: len(some.times) - 1])
    assert np.array_equal(some.positions[-1], motion.positions[-1])
    assert np.diff(some.times) == pytest.approx(0.012)
