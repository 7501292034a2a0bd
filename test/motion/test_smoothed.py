# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whole trajectories through the smoother, and the figures of motions that are known."""

import dataclasses

import numpy as np
import pytest

from epson_driver.motion import JointLimits, Trajectory
from epson_driver.motion import smoothed as smoothed_module
from epson_driver.motion.motion_figures import commanded_rests, measure
from epson_driver.motion.passages import passages, passed
from epson_driver.motion.smoothed import retimed, smoothed
from epson_driver.motion.smoother import MERGE_TOLERANCE, Mode, Plan, Request, plan

NAMES = ('a', 'b')
LIMITS = JointLimits(
    NAMES,
    np.full(2, -3.0),
    np.full(2, 3.0),
    np.array([8.0, 4.0]),
    np.array([50.0, 40.0]),
    np.array([500.0, 400.0]),
)
SHARE = np.linspace(0.0, 1.0, 12)[:, None]
CURVE = np.hstack([2.0 * SHARE - 1.0, np.sin(4.0 * SHARE)])
PLAN = Trajectory(NAMES, np.linspace(0.0, 2.2, 12), CURVE)


@pytest.mark.parametrize('mode', Mode)
@pytest.mark.parametrize('look_ahead', [np.inf, 0.6])
def test_the_motion_goes_through_all_points_without_a_stop_within_the_limits(mode, look_ahead):
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


def test_points_are_as_far_apart_as_was_asked():
    fine, coarse = smoothed(PLAN, LIMITS, period=0.004), smoothed(PLAN, LIMITS, period=0.1)
    assert np.diff(fine.times) == pytest.approx(0.004)
    assert np.diff(coarse.times) == pytest.approx(0.1)
    assert coarse.duration - 0.1 < fine.duration <= coarse.duration + 1e-9


def test_joints_are_put_in_order_and_the_first_time_is_kept():
    swapped = Trajectory(NAMES[::-1], PLAN.times + 0.5, CURVE[:, ::-1])
    motion, same = smoothed(swapped, LIMITS), smoothed(PLAN, LIMITS)
    assert motion.joint_names == NAMES
    assert motion.positions == pytest.approx(same.positions)
    assert motion.times == pytest.approx(same.times + 0.5)


def test_a_single_point_is_a_rest():
    motion = smoothed(Trajectory(NAMES, np.zeros(1), CURVE[:1]), LIMITS)
    assert np.all(motion.positions == CURVE[0])
    assert len(motion.times) >= 2


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'index': 3, 'value': 4.0}, 'point 3, b: position 4 is outside the limits -3 … 3 rad'),
        ({'index': 0, 'value': np.nan}, 'b: position nan is outside the limits'),
    ],
)
def test_what_cannot_be_smoothed_is_named(change, words):
    positions = CURVE.copy()
    positions[change['index'], 1] = change['value']
    with pytest.raises(ValueError, match=words):
        smoothed(Trajectory(NAMES, PLAN.times, positions), LIMITS)


def test_numbers_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match='period = 0'):
        smoothed(PLAN, LIMITS, period=0.0)
    with pytest.raises(ValueError, match='look_ahead = nan'):
        smoothed(PLAN, LIMITS, look_ahead=np.nan)
    still = Trajectory(NAMES, PLAN.times, CURVE)
    with pytest.raises(ValueError, match='no velocities'):
        measure(still, None, LIMITS)
    with pytest.raises(ValueError, match='no velocities'):
        passed(CURVE, still)


def motion_of(times, position):
    """Return a motion of joint a alone, from a function of time."""
    q = position(times)
    v = np.gradient(q, times)
    columns = [np.stack([each, 0.0 * each], axis=1) for each in (q, v, np.gradient(v, times))]
    return Trajectory(NAMES, times, *columns)


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


def test_passages_are_found_between_samples_and_in_order():
    times = np.arange(0.0, 2.005, 0.01)
    motion = motion_of(times, lambda times: np.sin(np.pi * times))  # up, down, and up again
    a = [0.0, 0.5, 1.0, 0.5, -1.0, 0.0]
    waypoints = np.stack([a, [0.0, 0.0, 0.0, 0.0, 0.1, 0.0]], axis=1)
    errors, when = passed(waypoints, motion)
    expected = np.array([0.0, 1 / 6, 0.5, 5 / 6, 1.5, 2.0])
    assert np.abs(when - expected)[[0, 1, 2, 3, 5]].max() < 0.02
    assert abs(when[4] - 1.5) < 0.15  # 0.1 rad away all that time
    assert errors[[0, 1, 2, 3, 5]].max() < 1e-4
    assert errors[4] == pytest.approx(0.1)
    assert passages(waypoints, motion.positions)[0] == 0


def test_long_motions_are_searched_sparingly_with_the_same_result(monkeypatch):
    motion = smoothed(PLAN, LIMITS, period=0.001)
    expected = passed(CURVE, motion)
    monkeypatch.setattr(smoothed_module, 'MOST', 1000)
    errors, times = passed(CURVE, motion)
    assert errors == pytest.approx(expected[0])
    assert times == pytest.approx(expected[1])


def test_retimed_is_the_same_plan_in_other_times():
    plan = retimed(Trajectory(NAMES, np.zeros(12), CURVE), LIMITS)
    assert np.array_equal(plan.positions, CURVE)
    assert np.all(np.diff(plan.times) > 0.0)
    assert plan.duration == smoothed(PLAN, LIMITS, Mode.TIME_OPTIMAL).duration
    assert np.abs(plan.velocities / LIMITS.velocity).max() <= 1.0


def test_retimed_leaves_out_points_that_count_as_one():
    doubled = np.repeat(CURVE, 2, axis=0)
    doubled[1::2, 0] += MERGE_TOLERANCE / 4
    plan = retimed(Trajectory(NAMES, np.zeros(24), doubled), LIMITS)
    assert len(plan.times) == 12
    assert np.array_equal(plan.positions[-1], doubled[-1])


@pytest.mark.invariant(2)
def test_a_motion_that_would_break_a_limit_is_refused() -> None:
    """Invariant 2: whoever plans wrongly, nothing of it is handed on."""

    def too_fast(request: Request, limits: JointLimits) -> Plan | None:
        faster = dataclasses.replace(
            limits,
            velocity=10.0 * limits.velocity,
            acceleration=10.0 * limits.acceleration,
            jerk=10.0 * limits.jerk,
        )
        return plan(request, faster)

    with pytest.raises(ValueError, match=r'breaks a limit: .* is beyond the limit'):
        smoothed(PLAN, LIMITS, Mode.TIME_OPTIMAL, planner=too_fast)
