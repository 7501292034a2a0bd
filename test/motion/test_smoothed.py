# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whole trajectories through the smoother."""

import dataclasses
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from support.smoother_harness import CURVE, LIMITS, NAMES, PLAN

from epson_driver.motion import JointLimits, Trajectory, smooth
from epson_driver.motion.closest_samples import passed
from epson_driver.motion.smoothed import every, retimed, smoothed, thinned
from epson_driver.motion.smoother import MERGE_TOLERANCE, Mode, Plan, Request, plan
from epson_driver.report.smooth_study import measure


@pytest.mark.parametrize('mode', Mode)
@pytest.mark.parametrize('look_ahead', [np.inf, 0.6])
def test_motion_passes_all_points_without_a_stop_within_the_limits(mode, look_ahead):
    motion = smoothed(PLAN, LIMITS, mode, look_ahead, 0.001)
    figures = measure(motion, None, LIMITS)
    assert figures.stops == 0
    assert figures.velocity <= 1.0
    assert figures.acceleration <= 1.0
    assert figures.jerk <= 1.02
    errors, times = passed(CURVE, motion)
    assert errors.max() < 1e-5
    assert np.all(np.diff(times) > 0.0)
    assert np.array_equal(motion.positions[0], CURVE[0])
    assert np.abs(motion.positions[-1] - CURVE[-1]).max() < 1e-9
    assert not motion.velocities[[0, -1]].any()
    assert not motion.accelerations[[0, -1]].any()
    limit = 1.2 * PLAN.duration if mode is Mode.TIME_PRESERVING else 0.6 * PLAN.duration
    assert figures.duration < limit


def test_points_have_the_requested_period():
    fine, coarse = smoothed(PLAN, LIMITS, period=0.004), smoothed(PLAN, LIMITS, period=0.1)
    assert np.diff(fine.times) == pytest.approx(0.004)
    assert np.diff(coarse.times) == pytest.approx(0.1)
    assert coarse.duration - 0.1 < fine.duration <= coarse.duration + 1e-9


def test_joints_are_reordered_and_the_first_time_kept():
    swapped = Trajectory(NAMES[::-1], PLAN.times + 0.5, CURVE[:, ::-1])
    motion, same = smoothed(swapped, LIMITS), smoothed(PLAN, LIMITS)
    assert motion.joint_names == NAMES
    assert motion.positions == pytest.approx(same.positions)
    assert motion.times == pytest.approx(same.times + 0.5)


def test_smooth_motion_through_a_single_point_is_a_rest():
    motion = smoothed(Trajectory(NAMES, np.zeros(1), CURVE[:1]), LIMITS)
    assert np.all(motion.positions == CURVE[0])
    assert len(motion.times) >= 2


def test_invalid_arguments_of_smoothing_are_rejected():
    with pytest.raises(ValueError, match='period = 0'):
        smoothed(PLAN, LIMITS, period=0.0)
    with pytest.raises(ValueError, match='look_ahead = nan'):
        smoothed(PLAN, LIMITS, look_ahead=np.nan)
    still = Trajectory(NAMES, PLAN.times, CURVE)
    with pytest.raises(ValueError, match='no velocities'):
        measure(still, None, LIMITS)
    with pytest.raises(ValueError, match='no velocities'):
        passed(CURVE, still)


def test_retimed_changes_only_the_times():
    plan = retimed(Trajectory(NAMES, np.zeros(12), CURVE), LIMITS)
    assert np.array_equal(plan.positions, CURVE)
    assert np.all(np.diff(plan.times) > 0.0)
    assert plan.duration == smoothed(PLAN, LIMITS, Mode.TIME_OPTIMAL, refine=False).duration
    assert np.abs(plan.velocities / LIMITS.velocity).max() <= 1.0


def test_retimed_merges_close_points():
    doubled = np.repeat(CURVE, 2, axis=0)
    doubled[1::2, 0] += MERGE_TOLERANCE / 4
    plan = retimed(Trajectory(NAMES, np.zeros(24), doubled), LIMITS)
    assert len(plan.times) == 12
    assert np.array_equal(plan.positions[-1], doubled[-1])


@pytest.mark.invariant(2)
def test_motion_beyond_a_limit_is_rejected() -> None:
    """Invariant 2: a wrong plan is not returned."""

    def too_fast(request: Request, limits: JointLimits) -> Plan | None:
        faster = dataclasses.replace(
            limits,
            velocity=10.0 * limits.velocity,
            acceleration=10.0 * limits.acceleration,
            jerk=10.0 * limits.jerk,
        )
        return plan(request, faster)

    with pytest.raises(ValueError, match=r'breaks a limit: .* is beyond the limit'):
        smoothed(PLAN, LIMITS, Mode.TIME_OPTIMAL, planner=too_fast, refine=False)


def distance_from_lines(motion, points):
    """Return a motion's distance from the lines between points, in the worst joint."""
    worst = 0.0
    for place in motion.positions:
        nearest = np.inf
        for start, end in pairwise(points):
            along = end - start
            fraction = np.clip((place - start) @ along / max(along @ along, 1e-30), 0.0, 1.0)
            nearest = min(nearest, np.abs(place - start - fraction * along).max())
        worst = max(worst, nearest)
    return worst


@pytest.mark.parametrize('spacing', [0.12, 0.15, 0.2, 0.25])
def test_thinned_points_are_spaced_points_of_the_plan(spacing):
    dense = smoothed(PLAN, LIMITS, period=0.02)
    few = thinned(dense, LIMITS, spacing)
    gaps = np.diff(few.times)
    assert gaps.min() >= spacing - 1e-9
    assert gaps.max() <= 2.0 * spacing + 0.02
    beside = np.abs(few.positions[:, None] - dense.positions).max(axis=2).min(axis=1)
    assert beside.max() <= 1e-5
    assert few.duration == pytest.approx(dense.duration, abs=0.1)
    assert np.array_equal(few.positions[[0, -1]], dense.positions[[0, -1]])
    assert np.abs(few.velocities[[0, -1]]).max() == 0.0


def test_lines_between_thinned_points_stay_within_the_deviation():
    """A controller that moves straight between the points follows the plan."""
    motion = smoothed(PLAN, LIMITS)
    counts = []
    for deviation in (np.inf, 0.02, 0.002):
        few = thinned(PLAN, LIMITS, 0.15, deviation)
        counts.append(len(few.times))
        if np.isfinite(deviation):
            assert distance_from_lines(motion, few.positions) <= deviation + 1e-6
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


def test_dense_points_are_left_out_where_a_straight_move_is_near():
    dense = smoothed(PLAN, LIMITS, period=0.02)
    few = thinned(dense, LIMITS, 0.15, 0.02)
    assert distance_from_lines(dense, few.positions) <= 0.02 + 1e-6
    assert len(few.times) <= 10


def test_distant_points_get_intermediate_points():
    sparse = thinned(PLAN, LIMITS, 0.05)
    assert np.diff(sparse.times).max() <= 0.1 + 1e-9
    for place in CURVE:
        assert np.abs(sparse.positions - place).max(axis=1).min() < 1e-5


def test_plans_of_one_or_two_points_can_be_thinned():
    one = thinned(Trajectory(NAMES, np.zeros(1), CURVE[:1]), LIMITS, 0.15)
    assert np.all(one.positions == CURVE[0])
    two = thinned(Trajectory(NAMES, np.array([0.0, 0.4]), CURVE[:2]), LIMITS, 0.15)
    assert np.array_equal(two.positions[[0, -1]], CURVE[:2])


@pytest.mark.parametrize(('spacing', 'deviation'), [(0.0, 1.0), (-1.0, 1.0), (0.1, 0.0)])
def test_nonpositive_spacing_or_deviation_is_rejected(spacing, deviation):
    with pytest.raises(ValueError, match='must be positive'):
        thinned(PLAN, LIMITS, spacing, deviation)


# --- smooth(): one call


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


def test_every_third_sample_keeps_both_ends() -> None:
    motion = smoothed(PLAN, LIMITS)
    some = every(motion, 3)
    assert np.array_equal(some.positions[:-1], motion.positions[::3][: len(some.times) - 1])
    assert np.array_equal(some.positions[-1], motion.positions[-1])
    assert np.diff(some.times) == pytest.approx(0.012)
