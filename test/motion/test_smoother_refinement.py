# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The path between sparse waypoints that takes the least time, and the tolerance beside them.

Invariant 2 of docs/invariants.md: a better path keeps every limit as well.
"""

import dataclasses

import numpy as np
import pytest
from support.smoother_harness import ARM, SLOW

from benchmark.exact_extrema import Recorded, exact_extrema
from benchmark.limit_sets import limit_set
from benchmark.trajectories import benchmark_set
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.motion.smoothed import retimed, smoothed
from epson_driver.motion.smoother import (
    Mode,
    Smoother,
    optimal,
    planner,
    refinement,
    refinement_policy,
)
from epson_driver.motion.smoother.effort import Effort
from epson_driver.motion.smoother.path import Knots, Path, through
from epson_driver.motion.smoother.problem import Problem
from epson_driver.motion.smoother.refinement_rows import BEND_RATIO, MIN_BEND, Freedom
from epson_driver.motion.smoother.request import Plan, Request
from epson_driver.motion.smoother.speed_bounds import SpeedBounds

CYCLE_S = 0.004
SPARSE = ('around_pillar_fast_100ms', 'totg_100ms', 'totg_100ms_long', 'sparse_corners')
QUICK = ('around_pillar_fast_100ms', 'half')
"""Of these the one of `make test`."""
LIMIT_SLACK = 1.0 + 1e-6

Asked = list[tuple[Request, Plan | None]]

pytestmark = pytest.mark.invariant(2)


def positions_of(name: str) -> Array:
    return next(each.positions for each in benchmark_set() if each.name == name)


def zigzag(count: int = 7, seed: int = 5) -> Array:
    """Return points far apart in the middle of the slow arm's range, shape (count, 3)."""
    return np.random.default_rng(seed).uniform(-1.2, 1.2, (count, 3))


def move(
    limits: JointLimits,
    positions: Array,
    look_ahead: float = np.inf,
    durations: list[float] | None = None,
    **settings: object,
) -> tuple[Recorded, Asked]:
    """Return a smoother that has gone through points, and what was planned for it."""
    asked: Asked = []

    def counted(request: Request, limits: JointLimits) -> Plan | None:
        asked.append((request, planner.plan(request, limits)))
        return asked[-1][1]

    mode = Mode.TIME_OPTIMAL if durations is None else Mode.TIME_PRESERVING
    smoother = Recorded(limits, positions[0], mode, planner=counted, **settings)
    fed = 1
    while fed < len(positions) or smoother.moving:
        while fed < len(positions) and smoother.look_ahead < look_ahead:
            smoother.append(positions[fed], None if durations is None else durations[fed - 1])
            fed += 1
            if fed == len(positions):
                smoother.finish()
        smoother.step(CYCLE_S)
        assert smoother.now < 60.0
    assert smoother.violations == smoother.planner_errors == 0
    return smoother, asked


def assert_within(limits: JointLimits, smoother: Recorded, start: Array) -> None:
    extrema = exact_extrema(smoother, start)
    assert extrema.velocity <= LIMIT_SLACK
    assert extrema.acceleration <= LIMIT_SLACK
    assert extrema.jerk <= LIMIT_SLACK
    assert extrema.outside <= 1e-9
    assert extrema.position_jump <= 1e-9


def problem_on(path: Path, limits: JointLimits) -> Problem:
    return Problem(path, (0.0, 0.0, 0.0), limits, effort=Effort(1e9))


def spline_through(points: Array, limits: JointLimits) -> Path:
    zeros = np.zeros((1, points.shape[1]))
    return through(Knots(np.zeros(1), points[:1], zeros, zeros), points[1:], limits, False, True)


def bends(path: Path) -> Array:
    """Return how far each segment is from the straight way, in any joint, shape (k - 1,)."""
    knots, found = path.knots, []
    for i in range(len(knots.u) - 1):
        q = path.sample(np.linspace(knots.u[i], knots.u[i + 1], 101))[0] - knots.position[i]
        way = knots.position[i + 1] - knots.position[i]
        share = np.clip(q @ way / (way @ way), 0.0, 1.0)
        found.append(np.abs(q - share[:, None] * way).max())
    return np.array(found)


def derivatives_free(path: Path) -> Freedom:
    free = np.ones((len(path.knots.u), 3), dtype=bool)
    free[:, 0] = False
    return Freedom(free, path.knots.position, np.zeros(len(free)), path)


@pytest.mark.parametrize(
    ('name', 'limits'),
    [
        pytest.param(name, limits, marks=[] if (name, limits) == QUICK else pytest.mark.slow)
        for name in SPARSE
        for limits in ('full', 'half')
    ],
)
def test_a_sparse_plan_takes_less_time_through_the_same_points(name: str, limits: str) -> None:
    """Every limit at every instant, every waypoint exactly, and no later than on the spline."""
    positions, arm = positions_of(name), limit_set(limits)
    plain, _ = move(arm, positions, refine=False)
    better, asked = move(arm, positions)
    assert better.now <= 0.98 * plain.now
    assert_within(arm, better, positions[0])
    most = max(BEND_RATIO * bends(spline_through(positions, arm)).max(), MIN_BEND)
    for _, plan in asked:
        assert plan is not None
        assert bends(Path(plan.knots)).max() <= 1.1 * most
        for position in plan.knots.position[1:]:
            assert np.abs(positions - position).max(axis=1).min() <= 1e-8


@pytest.mark.parametrize('look_ahead', [0.02, pytest.param(0.3, marks=pytest.mark.slow)])
def test_what_is_kept_of_a_path_in_motion_stays_to_the_last_bit(look_ahead: float) -> None:
    """Else the motion would jump: also where no more is known than the next points."""
    positions = zigzag(5)
    smoother, asked = move(SLOW, positions, look_ahead)
    moving = [(request, plan) for request, plan in asked if plan and len(request.kept.u) > 1]
    assert moving
    for request, plan in moving:
        for name in ('u', 'position', 'first', 'second'):
            kept = getattr(request.kept, name)
            assert getattr(plan.knots, name)[: len(kept)].tolist() == kept.tolist()
    assert_within(SLOW, smoother, positions[0])


def test_the_path_stays_as_near_to_the_straight_way_as_it_must() -> None:
    path = spline_through(zigzag(), SLOW)
    problem = problem_on(path, SLOW)
    bounds = SpeedBounds(problem)
    timing = optimal.propose(problem, bounds)
    better = refinement.refined(problem, bounds, timing, derivatives_free(path))
    assert better.knots.position.tolist() == path.knots.position.tolist()
    most = np.maximum(BEND_RATIO * bends(path), MIN_BEND)
    assert np.all(bends(better) <= 1.05 * most)  # between the places where it is held to that
    again = problem_on(better, SLOW)
    assert optimal.propose(again, SpeedBounds(again)).duration < 0.99 * timing.duration


def request_for(points: Array, **changes: object) -> Request:
    zeros = np.zeros((1, points.shape[1]))
    kept = Knots(np.zeros(1), points[:1], zeros, zeros)
    count = len(points)
    request = Request(
        None,
        (0.0, 0.0, 0.0),
        kept,
        None,
        points[1:],
        np.arange(float(count)),
        np.zeros(count, dtype=bool),
        0.0,
        1.0,
        100.0,
        True,
        whole=True,
        refine=True,
    )
    return dataclasses.replace(request, **changes)


def test_a_path_that_is_no_faster_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    path = spline_through(zigzag(), SLOW)
    problem = problem_on(path, SLOW)
    bounds = SpeedBounds(problem)
    timing = optimal.propose(problem, bounds)
    knots = path.knots
    worse = Path(Knots(knots.u, knots.position, 0.5 * knots.first, knots.second))
    monkeypatch.setattr(refinement_policy, 'refined', lambda *_: worse)
    found = refinement_policy.faster(request_for(zigzag()), problem, bounds, timing, Effort(1e9))
    assert found == (path, timing)


def test_a_path_that_leaves_the_range_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.6, 0.2, 0.1], [1.9, 0.1, 0.3], [0.5, 0.0, 0.9]])
    path = spline_through(points, SLOW)
    problem = problem_on(path, SLOW)
    bounds = SpeedBounds(problem)
    timing = optimal.propose(problem, bounds)
    steep = path.knots.first.copy()
    steep[2, 0] = 2.0
    beyond = Path(Knots(path.knots.u, points, steep, path.knots.second))
    assert beyond.outside(SLOW).any()
    monkeypatch.setattr(refinement_policy, 'refined', lambda *_: beyond)
    found = refinement_policy.faster(request_for(points), problem, bounds, timing, Effort(1e9))
    assert found == (path, timing)


def test_without_effort_left_the_plan_is_the_one_on_the_spline() -> None:
    path = spline_through(zigzag(), SLOW)
    problem = problem_on(path, SLOW)
    bounds = SpeedBounds(problem)
    timing = optimal.propose(problem, bounds)
    for left in (0.0, 3_000.0, 12_000.0):
        effort = Effort(left)
        found = refinement_policy.faster(request_for(zigzag()), problem, bounds, timing, effort)
        assert found[1].duration <= timing.duration
        assert left > 3_000.0 or found == (path, timing)


@pytest.mark.slow
def test_a_waypoint_on_the_border_of_the_range_stays_as_it_is() -> None:
    points = zigzag()
    points[2, 0], points[4, 1] = SLOW.position_max[0], SLOW.position_min[1]
    smoother, asked = move(SLOW, points)
    assert_within(SLOW, smoother, points[0])
    assert all(plan is not None for _, plan in asked)


def test_points_with_times_are_followed_on_the_spline() -> None:
    points = zigzag(4)
    durations = [0.9] * (len(points) - 1)
    motions = [move(SLOW, points, durations=durations, refine=refine) for refine in (True, False)]
    (one, asked), (other, _) = motions
    assert not any(request.refine for request, _ in asked)
    assert one.now == other.now
    for (_, mine), (_, its) in zip(asked, motions[1][1], strict=True):
        assert mine.knots.first.tolist() == its.knots.first.tolist()
        assert mine.timing.times.tolist() == its.timing.times.tolist()


@pytest.mark.slow
def test_times_that_others_are_to_keep_are_those_on_the_spline() -> None:
    """Who follows the times of `retimed` bends as a spline does, and could not keep others."""
    points, arm = positions_of('around_pillar_11_points'), limit_set('full')
    trajectory = Trajectory(arm.names, np.arange(float(len(points))), points)
    plain = smoothed(trajectory, arm, Mode.TIME_OPTIMAL, refine=False)
    assert retimed(trajectory, arm).duration == pytest.approx(plain.duration, abs=1e-9)
    assert smoothed(trajectory, arm, Mode.TIME_OPTIMAL).duration < 0.98 * plain.duration


@pytest.mark.parametrize('look_ahead', [np.inf, pytest.param(0.3, marks=pytest.mark.slow)])
def test_with_a_tolerance_the_path_passes_beside_the_points(look_ahead: float) -> None:
    positions, arm = positions_of('around_pillar_fast_100ms'), limit_set('half')
    exact, _ = move(arm, positions, look_ahead)
    tolerance = 0.01
    beside, asked = move(arm, positions, look_ahead, path_tolerance=tolerance)
    assert look_ahead < np.inf or beside.now < 0.97 * exact.now
    assert_within(arm, beside, positions[0])
    assert beside.motion.position.tolist() == positions[-1].tolist()
    missed = []
    for _, plan in asked:
        apart = np.abs(plan.knots.position[:, None] - positions).max(axis=2).min(axis=1)
        missed += apart.tolist()
    assert 1e-4 < max(missed) <= tolerance * 1.01


def test_a_tolerance_counts_for_points_without_times_in_either_mode() -> None:
    points = zigzag(4)
    exact, beside = (
        Smoother(SLOW, points[0], path_tolerance=tolerance) for tolerance in (0.0, 0.05)
    )
    for smoother in (exact, beside):
        for point in points[1:]:
            smoother.append(point)
        smoother.finish()
        while smoother.moving:
            smoother.step(CYCLE_S)
    assert beside.now < exact.now


def test_the_path_keeps_the_order_of_points_that_are_near_to_each_other() -> None:
    points = np.concatenate([zigzag(3), zigzag(3)[-1] + 0.002 * np.arange(1, 4)[:, None]])
    freedom = refinement_policy._freedom(
        request_for(points, tolerance=0.5), spline_through(points, SLOW), SLOW
    )
    ways = np.abs(np.diff(points, axis=0)).max(axis=1)
    near = np.minimum(ways[:-1], ways[1:])
    assert freedom.tolerance[1:-1].tolist() == np.minimum(0.25 * near, 0.5).tolist()
    assert not freedom.free[[0, -1], 0].any()


@pytest.mark.parametrize('value', [-0.001, 0.51, float('nan'), float('inf')])
def test_a_tolerance_that_is_wrong_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match=r'path_tolerance = .* rad: must be 0 … 0.5'):
        Smoother(ARM, np.zeros(6), path_tolerance=value)
