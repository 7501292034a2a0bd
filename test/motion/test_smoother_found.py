# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Runs that once failed, and failing planners.

Invariants 2, 3 and 9 of docs/invariants.md.
"""

import logging

import numpy as np
import pytest
from support.smoother_harness import ARM, assert_within_all_limits

from epson_driver.motion import Trajectory
from epson_driver.motion.smoothed import smoothed
from epson_driver.motion.smoother import Smoother
from epson_driver.motion.smoother.planner import plan

NO_LENGTH = (2095, pytest.param(2134, marks=pytest.mark.slow))
"""The arm was at rest on a point up to rounding, so the path had length 0, and NaN followed."""

CRAWLING = tuple(pytest.param(seed, marks=pytest.mark.slow) for seed in (2298, 2819, 2950))
"""A sharp bend of 1e-4 rad made a move take a minute, because no shorter one was tried."""


@pytest.mark.filterwarnings('error::RuntimeWarning')
@pytest.mark.parametrize('seed', NO_LENGTH + CRAWLING)
def test_formerly_failed_run_respects_all_limits_and_ends_at_rest(seed: int) -> None:
    assert_within_all_limits(seed, 1e-3 if seed % 10 else 1e-4)


class Failing:
    """A planner that raises while `fails` is set."""

    def __init__(self) -> None:
        self.fails = False

    def __call__(self, request, limits):
        if self.fails:
            raise ZeroDivisionError('injected')
        return plan(request, limits)


def test_raising_planner_lets_the_arm_stop_on_its_current_plan(caplog):
    """Invariant 9: an error in planning ends neither the controller nor the motion."""
    start = np.zeros(6)
    planner = Failing()
    smoother = Smoother(ARM, start, planner=planner)
    for index in range(1, 40):
        smoother.append(start + 0.025 * index, 0.05)
    smoother.finish()
    for _ in range(200):
        smoother.step(1e-3)
    assert not smoother.at_rest
    planner.fails = True
    with caplog.at_level(logging.ERROR):
        for _ in range(20_000):
            smoother.step(1e-3)
            if smoother.at_rest:
                break
    assert smoother.at_rest
    assert smoother.moving, 'the points are kept'
    assert smoother.violations == 0
    assert smoother.planner_errors > 1
    assert isinstance(smoother.planner_error, ZeroDivisionError)
    (record,) = caplog.records
    assert record.exc_info is not None, 'logged once with its traceback'
    planner.fails = False
    for _ in range(20_000):
        smoother.step(1e-3)
        if not smoother.moving:
            break
    assert not smoother.moving
    assert smoother.violations == 0
    assert np.allclose(smoother.motion.position, start + 0.025 * 39, atol=1e-9)


def test_smoothing_with_a_raising_planner_raises():
    planner = Failing()
    planner.fails = True
    positions = np.array([np.zeros(6), np.full(6, 0.1)])
    trajectory = Trajectory(ARM.names, np.array([0.0, 1.0]), positions)
    with pytest.raises(RuntimeError, match='the planner failed'):
        smoothed(trajectory, ARM, planner=planner)
