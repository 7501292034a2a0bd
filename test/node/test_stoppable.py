# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smooth motions with a stop at any moment form one motion within the limits."""

from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from support.examples import one_in
from support.smoother_harness import LIMITS, PLAN

from epson_driver.motion import Trajectory
from epson_driver.motion.interpolation import Interpolation, hermite, polynomial
from epson_driver.motion.smoothed import MAX_STEP_S, smoothed, time_optimal
from epson_driver.node import stoppable
from epson_driver.node.stoppable import StoppableMotion

LONGEST_S = 0.008


def quintics(points: Trajectory) -> Interpolation:
    """Return the interpolation of joint_trajectory_controller."""
    return Interpolation(points.times, points.positions, points.velocities, points.accelerations)


def largest(points: Trajectory) -> list[float]:
    """Return the largest velocity, acceleration and jerk of the quintics, per limit."""
    assert points.velocities is not None and points.accelerations is not None  # noqa: PT018
    h = np.diff(points.times)[:, None]
    rows = (points.positions, points.velocities, points.accelerations)
    ends = [
        [row[part] * h**n for n, row in enumerate(rows)] for part in (slice(-1), slice(1, None))
    ]
    coefficients = hermite(tuple(ends[0]), tuple(ends[1]))
    fractions = np.linspace(0.0, 1.0, 33)
    ratios = []
    for order, limit in enumerate((LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk), start=1):
        values = [polynomial(segment, fractions, order) for segment in coefficients]
        ratios.append(float(np.max(np.abs(values) / h[:, None] ** order / limit)))
    return ratios


@pytest.mark.invariant(2, 3)
@pytest.mark.parametrize('plan', [PLAN, time_optimal(PLAN, LIMITS)])
@pytest.mark.parametrize('fraction', one_in(3, [0.0, 0.03, 0.2, 0.5, 0.77, 0.97, 1.0]))
def test_motion_and_its_stop_are_one_motion_within_the_limits(
    plan: Trajectory, fraction: float
) -> None:
    whole = StoppableMotion(plan, LIMITS)
    motion = whole.motion
    assert np.array_equal(motion.positions, smoothed(plan, LIMITS).positions)
    time = fraction * motion.duration
    whole.follow(time / 2)
    stopped = whole.stopped(time, LONGEST_S)
    assert np.diff(stopped.times).max(initial=0.0) <= LONGEST_S + 1e-9
    steps = int(time / MAX_STEP_S + 1e-9)
    for points in (whole.points(LONGEST_S), stopped)[: 2 if steps else 1]:
        path = quintics(points).at(MAX_STEP_S * np.arange(steps))[0]
        assert np.abs(path - motion.positions[:steps]).max(initial=0.0) < 1e-8
        assert max(largest(points)) <= 1.0 + 1e-3
        assert points.velocities is not None and not points.velocities[-1].any()  # noqa: PT018
        assert points.accelerations is not None and not points.accelerations[-1].any()  # noqa: PT018
    stopping = LIMITS.velocity / LIMITS.acceleration + LIMITS.acceleration / LIMITS.jerk
    assert stopped.duration <= time + 2.5 * stopping.max()


def test_stop_in_the_past_is_rejected() -> None:
    whole = StoppableMotion(PLAN, LIMITS)
    whole.follow(1.0)
    with pytest.raises(ValueError, match=r'cannot compute a stop at 0\.5 s'):
        whole.stopped(0.5, LONGEST_S)


@pytest.mark.invariant(9)
def test_inv9_planning_can_be_cancelled_at_every_sample_and_point() -> None:
    """docs/invariants.md, 9."""
    calls, cancelled = count(), False

    def check() -> None:
        if next(calls) and cancelled:
            raise KeyboardInterrupt

    whole = StoppableMotion(PLAN, LIMITS, checkpoint=check)
    assert next(calls) >= len(whole.motion.times)
    cancelled = True
    for work in (
        lambda: StoppableMotion(PLAN, LIMITS, checkpoint=check),
        lambda: whole.points(0.1),
    ):
        with pytest.raises(KeyboardInterrupt):
            work()


@pytest.mark.invariant(7)
def test_inv7_long_motion_is_rejected_before_and_during_sampling(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """docs/invariants.md, 7."""
    long = replace(PLAN, times=PLAN.times * 1e6)
    with pytest.raises(ValueError, match=r'point \d+: time_from_start = .* at most 600 s'):
        StoppableMotion(long, LIMITS, checkpoint=lambda: None)
    with pytest.raises(ValueError, match='100000 points'):
        StoppableMotion(PLAN, LIMITS).points(1e-6)
    monkeypatch.setattr(stoppable, 'MAX_DURATION_S', PLAN.duration)
    with pytest.raises(ValueError, match='or later: a smooth motion must take at most'):
        StoppableMotion(PLAN, replace(LIMITS, velocity=LIMITS.velocity / 10.0))


def test_stop_has_no_points_before_its_start() -> None:
    whole, other = StoppableMotion(PLAN, LIMITS), StoppableMotion(PLAN, LIMITS)
    stop, rest = whole.stopped(1.0, LONGEST_S), other.stopped(1.0, LONGEST_S, 0.9)
    assert rest.times[0] >= 0.9
    later = stop.times >= 0.9
    assert np.array_equal(rest.times, stop.times[later])
    assert np.array_equal(rest.positions, stop.positions[later])
