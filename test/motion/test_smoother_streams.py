# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams of points without an end in sight: the arm follows them, however fast they come."""

import numpy as np
import pytest
from support.examples import one_in
from support.smoother_harness import ARM

from epson_driver.motion.smoother import Mode, Smoother
from epson_driver.motion.smoother.replanning import MIN_PERIOD_S, START_PATIENCE_S

CYCLE_S = 0.004
SPEED_RAD_S = 0.25
LATENCY_S = 0.02


def followed(
    step: float, period: float, duration: float | None
) -> tuple[float | None, float, int]:
    """Stream points of 0.25 rad/s · `step` for a second.

    Return the start, the largest lag, and in how many cycles the arm stood after that start.
    """
    smoother = Smoother(ARM, np.zeros(6), Mode.TIME_PRESERVING, latency=LATENCY_S)
    direction = np.array([1.0, -0.5, 0.3, 0.2, 0.1, 0.4])
    begun, lag, sent, stood = None, 0.0, 0, 0
    for cycle in range(round(1.0 / CYCLE_S)):
        now = cycle * CYCLE_S
        while sent * period <= now:
            sent += 1
            smoother.append(sent * step * direction, duration)
        motion = smoother.step(CYCLE_S)
        if begun is None and np.any(motion.velocity):
            begun = now
        stood += begun is not None and not np.any(motion.velocity)
        if now > 0.5:
            lag = max(lag, (sent * step - motion.position[0]) / (step / period))
    return begun, lag, stood


@pytest.mark.parametrize('timed', [False, True])
@pytest.mark.parametrize('period', one_in(5, [0.01, 0.02, 0.05, 0.004, 0.025]))
def test_the_arm_does_not_wait_longer_because_more_points_come(period: float, timed: bool) -> None:
    begun, lag, stood = followed(SPEED_RAD_S * period, period, period if timed else None)
    assert begun is not None
    # with durations, until what is known lasts as long as it takes to have the next plan
    wait = max(START_PATIENCE_S, LATENCY_S + MIN_PERIOD_S if timed else 0.0)
    assert begun <= wait + LATENCY_S + 2.0 * CYCLE_S
    assert stood == 0
    assert lag < 0.15


def test_points_that_are_merged_into_the_last_one_do_not_keep_the_arm_waiting() -> None:
    """A stream that hovers beside a resting arm, by less than the merge tolerance."""
    smoother = Smoother(ARM, np.zeros(6))
    for _ in range(25):
        smoother.append(np.full(6, 2e-4))
        smoother.step(0.01)
    assert smoother.motion.position == pytest.approx(np.full(6, 2e-4), abs=1e-9)


def test_a_point_that_is_merged_while_the_arm_comes_to_rest_is_gone_to() -> None:
    """It comes too late for the plan to the point before, so the arm rests beside it first."""
    smoother = Smoother(ARM, np.zeros(6))
    smoother.append(np.full(6, 0.1))
    while smoother.motion.position[0] < 0.0999:
        smoother.step(CYCLE_S)
    assert not smoother.at_rest
    smoother.append(np.full(6, 0.1 + 1e-5))
    for _ in range(100):
        smoother.step(CYCLE_S)
    assert smoother.at_rest
    assert smoother.motion.position == pytest.approx(np.full(6, 0.1 + 1e-5), abs=1e-9)


def test_points_that_come_within_the_patience_are_planned_together() -> None:
    smoother = Smoother(ARM, np.zeros(6))
    smoother.append(np.full(6, 0.01))
    smoother.step(0.02)
    smoother.append(np.full(6, 0.02))
    assert smoother.at_rest, 'the patience is not over'
    smoother.step(0.02)
    smoother.step(CYCLE_S)
    assert not smoother.at_rest
