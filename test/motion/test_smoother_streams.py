# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams of points at different rates: the arm follows them."""

import numpy as np
import pytest
from support.examples import one_in
from support.smoother_harness import ARM

from epson_driver.motion.smoother import Mode, Smoother
from epson_driver.motion.smoother.replanning import MIN_PERIOD_S, START_DELAY_S

CYCLE_S = 0.004
SPEED_RAD_S = 0.25
LATENCY_S = 0.02


def followed(
    step: float, period: float, duration: float | None
) -> tuple[float | None, float, int]:
    """Stream points at steps of `step` for a second.

    Return the start time, the largest lag, and the cycles at rest after the start.
    """
    smoother = Smoother(ARM, np.zeros(6), Mode.TIME_PRESERVING, latency=LATENCY_S)
    direction = np.array([1.0, -0.5, 0.3, 0.2, 0.1, 0.4])
    started, lag, sent, idle = None, 0.0, 0, 0
    for cycle in range(round(1.0 / CYCLE_S)):
        now = cycle * CYCLE_S
        while sent * period <= now:
            sent += 1
            smoother.append(sent * step * direction, duration)
        motion = smoother.step(CYCLE_S)
        if started is None and np.any(motion.velocity):
            started = now
        idle += started is not None and not np.any(motion.velocity)
        if now > 0.5:
            lag = max(lag, (sent * step - motion.position[0]) / (step / period))
    return started, lag, idle


@pytest.mark.parametrize('timed', [False, True])
@pytest.mark.parametrize('period', one_in(5, [0.01, 0.02, 0.05, 0.004, 0.025]))
def test_arm_starts_soon_at_any_rate_of_points(period: float, timed: bool) -> None:
    started, lag, idle = followed(SPEED_RAD_S * period, period, period if timed else None)
    assert started is not None
    # with durations, until the known points last for the planning of the next plan
    wait = max(START_DELAY_S, LATENCY_S + MIN_PERIOD_S if timed else 0.0)
    assert started <= wait + LATENCY_S + 2.0 * CYCLE_S
    assert idle == 0
    assert lag < 0.15


def test_merged_points_do_not_delay_the_start() -> None:
    """The stream stays near a resting arm, within the merge tolerance."""
    smoother = Smoother(ARM, np.zeros(6))
    for _ in range(25):
        smoother.append(np.full(6, 2e-4))
        smoother.step(0.01)
    assert smoother.motion.position == pytest.approx(np.full(6, 2e-4), abs=1e-9)


def test_point_merged_during_braking_is_reached() -> None:
    """It is too late for the plan to the previous point, so the arm rests near it first."""
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


def test_points_within_the_start_delay_are_planned_together() -> None:
    smoother = Smoother(ARM, np.zeros(6))
    smoother.append(np.full(6, 0.01))
    smoother.step(0.02)
    smoother.append(np.full(6, 0.02))
    assert smoother.at_rest, 'the start delay is not over'
    smoother.step(0.02)
    smoother.step(CYCLE_S)
    assert not smoother.at_rest
