# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Points whose spline of time respects the limits: the smoother meets their times exactly.

Invariants 2 and 3 of docs/invariants.md: all limits hold, and no rest between the points.
"""

from itertools import count, pairwise

import numpy as np
import pytest
from support.examples import one_in
from support.smoother_harness import ARM, SLOW, assert_exact, resting_place

from benchmark.exact_extrema import Recorded, exact_extrema
from benchmark.goals import LIMITS, plans
from benchmark.trajectories import random_vias
from epson_driver.motion import Array, JointLimits, Trajectory, smooth
from epson_driver.motion.closest_samples import passed
from epson_driver.motion.smoothed import smoothed, time_optimal
from epson_driver.motion.smoother import Mode, planner
from epson_driver.motion.smoother.planner import AS_COMMANDED, plan
from epson_driver.motion.smoother.request import ActivePlan
from epson_driver.motion.smoother.waypoints import MERGE_TOLERANCE

pytestmark = pytest.mark.invariant(2, 3)

CYCLE_S = 0.004
REST = 1e-6  # rad/s


class Counted:
    """The planner, and the proposers of its plans."""

    def __init__(self) -> None:
        self.proposers: list[str] = []

    def __call__(self, request, limits):  # type: ignore[no-untyped-def]
        answer = plan(request, limits)
        self.proposers.append('' if answer is None else answer.proposer)
        return answer


def vias(seed: int, limits: JointLimits) -> Trajectory:
    """Return five distant points without meaningful times."""
    low, high = limits.position_min, limits.position_max
    middle, reach = (low + high) / 2.0, 0.35 * (high - low)
    random = np.random.default_rng([seed, 49])
    points = random_vias(random, 5, middle - reach, middle + reach)
    return Trajectory(limits.names, np.arange(5.0), points)


def on_the_wire(points: Trajectory) -> Trajectory:
    """Return a trajectory after messages with float32."""
    positions = points.positions.astype(np.float32).astype(float)
    durations = np.diff(points.times).astype(np.float32).astype(float)
    return Trajectory(points.joint_names, np.append(0.0, np.cumsum(durations)), positions)


def streamed(points: Trajectory, limits: JointLimits, each: float, stop: float = np.inf):  # type: ignore[no-untyped-def]
    """Move through points that arrive `each` s apart, as far as 1 s ahead.

    Return the smoother, the duration of its motion, the number of cycles at rest in it, and the
    proposers of its plans. At the time `stop` of the motion, s, the arm is stopped.
    """
    counted = Counted()
    start = points.positions[0]
    smoother = Recorded(limits, start, latency=0.012, planner=counted)
    sent, begin, end, resting, still = 1, np.inf, 0.0, 0, 0
    while sent < len(points.times) or smoother.moving:
        while (
            sent < len(points.times) and sent * each <= smoother.now and smoother.look_ahead < 1.0
        ):
            smoother.append(points.positions[sent], points.times[sent] - points.times[sent - 1])
            sent += 1
            if sent == len(points.times):
                smoother.finish()
        motion = smoother.step(CYCLE_S)
        if np.abs(motion.velocity).max() > REST:
            begin, end = min(begin, smoother.now - CYCLE_S), smoother.now
            resting += still
            still = 0
        elif begin < np.inf:
            still += 1
        if smoother.now - begin >= stop:
            smoother.stop()
            sent = len(points.times)
    assert smoother.violations == 0
    return smoother, end - begin, resting, counted.proposers


@pytest.mark.parametrize('limits', [ARM, SLOW])
@pytest.mark.parametrize('seed', one_in(12, range(12)))
@pytest.mark.parametrize(('each', 'late'), [(0.0, 1.01), (5e-4, 1.01), (2e-3, 1.12)])
def test_fastest_motion_is_executed_in_its_own_time(
    limits: JointLimits, seed: int, each: float, late: float
) -> None:
    points = on_the_wire(time_optimal(vias(seed, limits), limits))
    smoother, duration, resting, proposers = streamed(points, limits, each)
    assert set(proposers) == {AS_COMMANDED} or late > 1.1
    assert duration <= late * points.duration + 2.0 * CYCLE_S
    assert resting == 0
    assert_exact(exact_extrema(smoother, points.positions[0]))
    assert np.array_equal(smoother.motion.position, points.positions[-1])


@pytest.mark.parametrize('spacing', [0.01, 0.05, 0.1])
@pytest.mark.parametrize('speed', one_in(2, [1.0, 0.5]))
def test_fastest_motion_of_a_plan_is_as_fast_as_smooth(speed: float, spacing: float) -> None:
    ratios = []
    for given in plans(speed, spacing):
        points = time_optimal(given, LIMITS)
        ratios.append(points.duration / smooth(given.positions, LIMITS).duration)
    assert np.mean(ratios) <= 1.06
    assert max(ratios) <= 1.1


def test_fastest_motion_stays_as_near_to_the_lines_as_the_spline() -> None:
    for seed in range(3):
        given = vias(seed, ARM)
        motion = smoothed(time_optimal(given, ARM), ARM)
        spline = smoothed(given, ARM, Mode.TIME_OPTIMAL, refine=False)
        assert passed(given.positions, motion)[0].max() < 2.0 * MERGE_TOLERANCE
        assert _bend(motion, given.positions) <= 1.02 * _bend(spline, given.positions)


def _bend(motion: Trajectory, points: Array) -> float:
    """Return the largest distance of a motion from the line of its segment, in the worst joint."""
    times = passed(points, motion)[1]
    places = np.linspace(0.0, 1.0, 201)[:, None, None]
    worst = 0.0
    for (first, last), (start, end) in zip(pairwise(times), pairwise(points), strict=True):
        inside = motion.positions[(motion.times > first) & (motion.times < last)]
        distances = np.abs(inside - start - places * (end - start)).max(axis=2)
        worst = max(worst, distances.min(axis=0).max(initial=0.0))
    return worst


def test_points_on_a_line_are_skipped() -> None:
    share = np.linspace(0.0, 1.0, 200)[:, None]
    ends = vias(0, ARM).positions[:2]
    given = Trajectory(ARM.names, np.arange(200.0), ends[0] + share * (ends[1] - ends[0]))
    points = time_optimal(given, ARM)
    assert len(points.times) < 100
    assert points.duration <= 1.1 * smooth(ends, ARM).duration


@pytest.mark.parametrize('fraction', one_in(2, np.linspace(0.05, 0.95, 8)))
def test_stop_in_a_commanded_motion_respects_all_limits(fraction: float) -> None:
    points = time_optimal(vias(1, ARM), ARM)
    smoother, duration, _, _ = streamed(points, ARM, 0.0, fraction * points.duration)
    assert duration <= fraction * points.duration + 0.5
    assert_exact(exact_extrema(smoother, points.positions[0]))
    assert np.array_equal(smoother.motion.position, resting_place(smoother))


def test_arm_rests_at_the_last_point_if_a_commanded_stream_ends() -> None:
    points = time_optimal(vias(2, ARM), ARM)
    for number in range(20, len(points.times), 19):
        some = Trajectory(ARM.names, points.times[:number], points.positions[:number])
        smoother, *_ = streamed(some, ARM, 5e-4)
        assert_exact(exact_extrema(smoother, points.positions[0]))
        assert np.abs(smoother.motion.position - some.positions[-1]).max() < 1e-9


def test_later_points_that_are_too_fast_slow_the_arm_without_a_rest() -> None:
    points = time_optimal(vias(3, ARM), ARM)
    times = points.times.copy()
    half = len(times) // 2
    times[half:] = times[half] + (times[half:] - times[half]) / 1.4
    faster = Trajectory(ARM.names, times, points.positions)
    smoother, duration, resting, proposers = streamed(faster, ARM, 2e-3)
    assert AS_COMMANDED in proposers
    assert set(proposers) != {AS_COMMANDED}
    assert duration <= 1.4 * points.duration
    assert resting == 0
    assert_exact(exact_extrema(smoother, points.positions[0]))


@pytest.mark.parametrize('first', [2, 4, 6])
def test_path_that_leaves_the_lines_continues_without_a_rest(
    monkeypatch: pytest.MonkeyPatch, first: int
) -> None:
    """The motion continues by the length of the path."""
    numbers = count()
    monkeypatch.setattr(planner, '_is_near', lambda *_: next(numbers) < first)
    slow = ARM.scaled(0.2, 0.2)
    points = time_optimal(vias(7, slow), slow)
    smoother, duration, resting, _ = streamed(points, ARM, 5e-4)
    assert next(numbers) > first
    assert resting == 0
    assert duration <= 1.3 * points.duration
    assert_exact(exact_extrema(smoother, points.positions[0]))


@pytest.mark.parametrize('seed', one_in(2, [3, 4, 6, 8]))
def test_irregular_later_times_do_not_bend_the_path(seed: int) -> None:
    points = time_optimal(vias(seed, ARM), ARM)
    gaps = np.diff(points.times)
    gaps[len(gaps) // 2 :: 3] = 1e-3
    irregular = Trajectory(ARM.names, np.append(0.0, np.cumsum(gaps)), points.positions)
    smoother, *_ = streamed(irregular, ARM, 2e-3)
    assert_exact(exact_extrema(smoother, points.positions[0]))
    wanted = smoothed(points, ARM, period=0.002).positions
    for _, motion in smoother.executed:
        if isinstance(motion, ActivePlan):
            first, last = motion.timing.positions[[0, -1]].tolist()
            places = motion.path.sample(np.linspace(first, last, 300))[0]
            apart = np.abs(places[:, None] - wanted).max(axis=2).min(axis=1)
            assert apart.max() < 0.02


def test_hold_in_a_commanded_motion_loses_no_point() -> None:
    points = time_optimal(vias(4, ARM), ARM)
    smoother = Recorded(ARM, points.positions[0], latency=0.012)
    for position, duration in zip(points.positions[1:], np.diff(points.times), strict=True):
        smoother.append(position, float(duration))
    smoother.finish()
    samples = []
    for cycle in range(2000):
        samples.append(smoother.step(CYCLE_S).position)
        if cycle == 60:
            smoother.hold()
        elif cycle == 500:
            assert smoother.at_rest
            smoother.resume()
    assert not smoother.moving
    assert_exact(exact_extrema(smoother, points.positions[0]))
    times = CYCLE_S * np.arange(len(samples))
    motion = Trajectory(ARM.names, times, np.array(samples), np.gradient(samples, times, axis=0))
    assert passed(points.positions[::4], motion)[0].max() < 5e-3
