# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smooth motions that are left on their way, at any moment, as one motion inside the limits."""

from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from support.examples import one_in
from support.smoother_harness import LIMITS, PLAN

from epson_driver.motion import Trajectory, stoppable
from epson_driver.motion.interpolation import Interpolation, hermite, polynomial
from epson_driver.motion.smoothed import MAX_STEP_S, smoothed
from epson_driver.motion.smoother import Mode
from epson_driver.motion.stoppable import StoppableMotion

LONGEST_S = 0.008


def quintics(points: Trajectory) -> Interpolation:
    """Return what joint_trajectory_controller makes of points."""
    return Interpolation(points.times, points.positions, points.velocities, points.accelerations)


def largest(points: Trajectory) -> list[float]:
    """Return the largest velocity, acceleration and jerk of these quintics, of the limits."""
    assert points.velocities is not None and points.accelerations is not None  # noqa: PT018
    h = np.diff(points.times)[:, None]
    rows = (points.positions, points.velocities, points.accelerations)
    ends = [
        [row[part] * h**n for n, row in enumerate(rows)] for part in (slice(-1), slice(1, None))
    ]
    coefficients = hermite(tuple(ends[0]), tuple(ends[1]))
    shares = np.linspace(0.0, 1.0, 33)
    found = []
    for order, limit in enumerate((LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk), start=1):
        values = [polynomial(each, shares, order) for each in coefficients]
        found.append(float(np.max(np.abs(values) / h[:, None] ** order / limit)))
    return found


@pytest.mark.invariant(2, 3)
@pytest.mark.parametrize('mode', Mode)
@pytest.mark.parametrize('share', one_in(3, [0.0, 0.03, 0.2, 0.5, 0.77, 0.97, 1.0]))
def test_the_motion_and_its_stop_are_one_motion_inside_the_limits(
    mode: Mode, share: float
) -> None:
    whole = StoppableMotion(PLAN, LIMITS, mode)
    motion = whole.motion
    assert np.array_equal(motion.positions, smoothed(PLAN, LIMITS, mode, refine=False).positions)
    time = share * motion.duration
    whole.follow(time / 2)
    left = whole.stopped(time, LONGEST_S)
    assert np.diff(left.times).max(initial=0.0) <= LONGEST_S + 1e-9
    steps = int(time / MAX_STEP_S + 1e-9)
    for each in (whole.points(LONGEST_S), left)[: 2 if steps else 1]:
        way = quintics(each).at(MAX_STEP_S * np.arange(steps))[0]
        assert np.abs(way - motion.positions[:steps]).max(initial=0.0) < 1e-8
        assert max(largest(each)) <= 1.0 + 1e-3
        assert each.velocities is not None and not each.velocities[-1].any()  # noqa: PT018
        assert each.accelerations is not None and not each.accelerations[-1].any()  # noqa: PT018
    stopping = LIMITS.velocity / LIMITS.acceleration + LIMITS.acceleration / LIMITS.jerk
    assert left.duration <= time + 2.5 * stopping.max()


def test_a_stop_does_not_begin_in_the_past() -> None:
    whole = StoppableMotion(PLAN, LIMITS)
    whole.follow(1.0)
    with pytest.raises(ValueError, match=r'no stop at 0\.5 s'):
        whole.stopped(0.5, LONGEST_S)


@pytest.mark.invariant(9)
def test_inv9_every_sample_and_point_can_end_the_work() -> None:
    """docs/invariants.md, 9."""
    looks, left = count(), False

    def look() -> None:
        if next(looks) and left:
            raise KeyboardInterrupt

    whole = StoppableMotion(PLAN, LIMITS, look=look)
    assert next(looks) >= len(whole.motion.times)
    left = True
    for work in (lambda: StoppableMotion(PLAN, LIMITS, look=look), lambda: whole.points(0.1)):
        with pytest.raises(KeyboardInterrupt):
            work()


@pytest.mark.invariant(7)
def test_inv7_a_long_motion_is_refused_before_and_while_it_is_sampled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """docs/invariants.md, 7."""
    long = replace(PLAN, times=PLAN.times * 1e6)
    with pytest.raises(ValueError, match=r'point \d+: time_from_start = .* at most 600 s'):
        StoppableMotion(long, LIMITS, look=lambda: None)
    with pytest.raises(ValueError, match='100000 points'):
        StoppableMotion(PLAN, LIMITS).points(1e-6)
    monkeypatch.setattr(stoppable, 'MAX_DURATION_S', PLAN.duration)
    with pytest.raises(ValueError, match='or later: a smooth motion must take at most'):
        StoppableMotion(PLAN, replace(LIMITS, velocity=LIMITS.velocity / 10.0))


def test_a_stop_has_no_points_before_its_begin() -> None:
    whole, other = StoppableMotion(PLAN, LIMITS), StoppableMotion(PLAN, LIMITS)
    stop, rest = whole.stopped(1.0, LONGEST_S), other.stopped(1.0, LONGEST_S, 0.9)
    assert rest.times[0] >= 0.9
    kept = stop.times >= 0.9
    assert np.array_equal(rest.times, stop.times[kept])
    assert np.array_equal(rest.positions, stop.positions[kept])
