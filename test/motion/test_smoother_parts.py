# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Parts of the smoother: path, timings, verification, linear solvers."""

import dataclasses
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.motion import JointLimits
from epson_driver.motion.joint_motion import fastest_move, fastest_stop
from epson_driver.motion.smoother import MERGE_TOLERANCE, optimal, ruckig_move
from epson_driver.motion.smoother.banded import solve_pentadiagonal, solve_tridiagonal
from epson_driver.motion.smoother.limit_usage import limit_usage
from epson_driver.motion.smoother.path import Knots, Path, through
from epson_driver.motion.smoother.request import Problem
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.time_parametrisation import (
    TimeParametrisation,
    from_pieces,
)

LIMITS = JointLimits(
    ('a', 'b'),
    np.array([-2.0, -2.0]),
    np.array([2.0, 2.0]),
    np.array([3.0, 5.0]),
    np.array([20.0, 30.0]),
    np.array([200.0, 400.0]),
)


def at_rest(position: tuple[float, float]) -> Knots:
    zeros = np.zeros((1, 2))
    return Knots(np.zeros(1), np.array([position]), zeros, zeros)


def bow(count: int = 20) -> Path:
    s = np.linspace(0.0, 2.0, count)
    points = np.stack([np.sin(s), np.cos(2.0 * s)], axis=1)
    return through(at_rest((0.0, 1.0)), points[1:], LIMITS, clamped=False)


def unbound(path: Path) -> Problem:
    return Problem(path, (0.0, 0.0, 0.0), LIMITS)


def test_continued_path_is_flatter_at_a_limit_than_a_final_one() -> None:
    """A final path keeps the natural spline, because a flatter end would cost time."""
    points = np.array([[0.5, 0.1], [1.0, 0.2], [1.8, 0.3]])
    ends = [through(at_rest((0.0, 0.0)), points, LIMITS, False, final) for final in (False, True)]
    slopes = [path.knots.first[-1] for path in ends]
    assert 0.0 < slopes[0][0] < 0.9 * slopes[1][0]
    assert slopes[0][1] == pytest.approx(slopes[1][1])
    natural = through(at_rest((-1.0, 0.0)), points - [1.0, 0.0], LIMITS, False)
    assert slopes[1] == pytest.approx(natural.knots.first[-1])
    assert not any(path.outside(LIMITS).any() for path in ends)


def test_path_passes_its_points_with_continuous_curvature() -> None:
    path = bow()
    before = path.sample(path.knots.u[1:-1] - 1e-9)
    after = path.sample(path.knots.u[1:-1] + 1e-9)
    for left, right, tolerance in zip(before[:3], after[:3], (1e-7, 1e-4, 1e-2), strict=True):
        assert left == pytest.approx(right, abs=tolerance)
    positions = path.sample(path.knots.u)[0]
    assert positions == pytest.approx(path.knots.position, abs=1e-14)


def test_scalar_and_array_evaluation_of_a_path_agree() -> None:
    path = bow()
    us = np.linspace(0.0, path.end, 50)
    q, first, second, _ = path.sample(us)
    for index, u in enumerate(us):
        one = path.at(u)
        assert one[0] == pytest.approx(q[index], abs=1e-12)
        assert one[1] == pytest.approx(first[index], abs=1e-9)
        assert one[2] == pytest.approx(second[index], abs=1e-7)


def test_kept_knots_stay_unchanged() -> None:
    path = bow()
    kept = path.knots[:10]
    longer = through(kept, path.knots.position[10:] + 0.01, LIMITS)
    us = np.linspace(0.0, float(kept.u[-1]), 100)[:-1]
    for old, new in zip(path.sample(us), longer.sample(us), strict=True):
        assert new == pytest.approx(old, abs=1e-9)


def test_timing_is_the_integral_of_its_jerks() -> None:
    timing = from_pieces((1.0, 0.0, 0.0), np.full(4, 0.1), np.array([10.0, -10.0, -10.0, 10.0]))
    times = np.linspace(0.0, timing.duration, 4001)
    u, v, a, _ = timing.sample(times)
    assert v[:-1] + np.diff(u) / np.diff(times) == pytest.approx(
        v[:-1] + (v[1:] + v[:-1]) / 2, abs=1e-6
    )
    assert np.diff(a) / np.diff(times) == pytest.approx(
        timing.sample(times[:-1] + 1e-6)[3], abs=1e-6
    )
    assert timing.at(timing.duration + 1.0) == (timing.end, 0.0, 0.0)
    assert v[-1] == pytest.approx(0.0, abs=1e-12)


def test_verification_allows_every_proposed_timing() -> None:
    problem = unbound(bow())
    for timing in (optimal.propose(problem, SpeedBounds(problem)), ruckig_move.only_move(problem)):
        assert timing is not None
        assert limit_usage(problem.path, timing, LIMITS).allowed


def test_optimal_timing_is_the_fastest_and_uses_the_limits() -> None:
    problem = unbound(bow())
    best = optimal.propose(problem, SpeedBounds(problem))
    other = ruckig_move.only_move(problem)
    assert best is not None
    assert other is not None
    assert best.duration < other.duration
    load = limit_usage(problem.path, best, LIMITS)
    assert load.jerk.max() > 0.9


def test_optimal_timing_on_a_straight_line_agrees_with_ruckig() -> None:
    path = through(at_rest((-1.0, -1.0)), np.array([[1.0, 1.0]]), LIMITS, clamped=False)
    problem = unbound(path)
    best = optimal.propose(problem, SpeedBounds(problem))
    exact = ruckig_move.only_move(problem)
    assert best is not None
    assert exact is not None
    whole = ruckig_move.move(
        (0.0, 0.0, 0.0), path.end, *ruckig_move.slope_bounds(problem, path.end)
    )
    assert whole is not None
    assert best.duration == pytest.approx(whole.duration, rel=0.03)


def test_verification_detects_every_excess() -> None:
    path = bow()
    problem = unbound(path)
    timing = optimal.propose(problem, SpeedBounds(problem))
    assert timing is not None
    for quantity in ('velocity', 'acceleration', 'jerk'):
        used = float(getattr(limit_usage(path, timing, LIMITS), quantity).max())
        values = {name: getattr(LIMITS, name) for name in LIMITS.__dataclass_fields__}
        tighter = JointLimits(**(values | {quantity: values[quantity] * used * 0.99}))
        assert not limit_usage(path, timing, tighter).allowed
    narrow = JointLimits(
        LIMITS.names,
        LIMITS.position_min / 4.0,
        LIMITS.position_max,
        LIMITS.velocity,
        LIMITS.acceleration,
        LIMITS.jerk,
    )
    assert not limit_usage(path, timing, narrow).allowed


def sampled_usage(path: Path, timing: TimeParametrisation) -> list[float]:
    """Return the largest sampled multiples of the velocity, acceleration and jerk limits."""
    times = np.linspace(0.0, timing.duration, 100_001)
    u, v, a, j = (values[:, None] for values in timing.sample(times))
    _, first, second, third = path.sample(u[:, 0])
    values = (
        first * v / LIMITS.velocity,
        (first * a + second * v**2) / LIMITS.acceleration,
        (first * j + 3.0 * second * v * a + third * v**3) / LIMITS.jerk,
    )
    return [float(np.max(np.abs(value))) for value in values]


@pytest.mark.invariant(2)
@pytest.mark.parametrize('gap', [3e-4, 1e-3, 3e-3])
def test_verification_detects_an_excess_on_a_very_short_segment(
    gap: float,
) -> None:
    """Invariant 2: the verification needs no samples, which could miss a peak."""
    points = np.array([[0.8, 0.6], [0.8 + gap, 0.6 - gap / 2.0], [1.6, -0.4]])
    path = through(at_rest((-0.5, 0.2)), points, LIMITS, clamped=False)
    part = 0.08
    durations = np.array([2.0, 4.0, 2.0]) * part
    jerk = path.end / 16.0 / part**3
    # the segment is within one of the timing's three pieces
    fast = from_pieces((0.0, 0.0, 0.0), durations, np.array([jerk, -jerk, jerk]))
    assert fast.end == pytest.approx(path.end, rel=1e-9)
    for pace in (1.0, 0.5, 0.2):
        timing = slowed(fast, pace)
        sampled = sampled_usage(path, timing)
        usage = limit_usage(path, timing, LIMITS)
        assert not usage.allowed
        names = ('velocity', 'acceleration', 'jerk')
        for largest, name in zip(sampled, names, strict=True):
            bound = float(getattr(usage, name).max())
            assert bound >= largest * (1.0 - 1e-6)
            assert bound <= max(largest * 1.03, 1.0)


def test_verification_allows_exactly_up_to_the_limits() -> None:
    """A timing slowed until it is allowed uses a limit fully."""
    path = bow()
    timing = ruckig_move.move((0.0, 0.0, 0.0), path.end, 0.5, 3.0, 40.0)
    assert timing is not None
    low, high = 0.01, 1.0
    for _ in range(40):
        pace = (low + high) / 2.0
        if limit_usage(path, slowed(timing, pace), LIMITS).allowed:
            low = pace
        else:
            high = pace
    assert max(sampled_usage(path, slowed(timing, low))) == pytest.approx(1.0, abs=1e-4)


def slowed(timing: TimeParametrisation, pace: float) -> TimeParametrisation:
    return TimeParametrisation(
        timing.times / pace,
        timing.positions,
        timing.velocities * pace,
        timing.accelerations * pace**2,
        timing.jerks * pace**3,
    )


@pytest.mark.parametrize('quantity', ['positions', 'velocities', 'accelerations'])
@pytest.mark.parametrize('where', [3, -1])
def test_verification_detects_a_discontinuity_of_the_timing(quantity: str, where: int) -> None:
    path = bow()
    problem = unbound(path)
    timing = ruckig_move.only_move(problem)
    assert timing is not None
    assert limit_usage(path, timing, LIMITS).allowed
    values = getattr(timing, quantity).copy()
    values[where] += 1e-5
    assert not limit_usage(path, dataclasses.replace(timing, **{quantity: values}), LIMITS).allowed


def test_verification_detects_a_position_limit_grazed_between_samples() -> None:
    path = through(
        at_rest((0.0, 0.0)), np.array([[1.0, 0.5], [1.99, 1.0], [1.0, 1.5]]), LIMITS, clamped=False
    )
    problem = unbound(path)
    timing = ruckig_move.move((0.0, 0.0, 0.0), path.end, 0.2, 0.5, 5.0)
    assert timing is not None
    highest = float(path.sample(np.linspace(0.0, path.end, 200_001))[0].max())
    for excess, allowed in ((2e-9, False), (-2e-9, True)):
        grazed = dataclasses.replace(
            problem.limits, position_max=np.array([highest - excess, 2.0])
        )
        assert limit_usage(path, timing, grazed).inside is allowed


@given(st.integers(0, 10_000))
def test_path_never_leaves_the_position_limits(seed: int) -> None:
    """The points include some at the limits, or very near to them."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2.0, 2.0, (8, 2))
    near = rng.random((8, 2)) < 0.6
    hair = rng.choice([0.0, 1e-9, 1e-5, 1e-2], (8, 2))
    points[near] = (np.sign(points) * (2.0 - hair))[near]
    # like the smoother merges slow points
    apart = np.abs(np.diff(points, axis=0)).max(axis=1) > MERGE_TOLERANCE / 2.0
    points = points[np.append(True, apart)]
    path = through(at_rest((0.0, 0.0)), points, LIMITS, clamped=False)
    positions = path.sample(np.linspace(0.0, path.end, 20_001))[0]
    assert np.all(np.abs(positions) <= 2.0 + 1e-12)


@given(st.integers(0, 10_000))
def test_extended_path_never_leaves_the_position_limits(seed: int) -> None:
    """A kept knot may point steeply at a limit at which the next point is."""
    rng = np.random.default_rng(seed)
    points = np.clip(rng.uniform(-3.0, 3.0, (8, 2)), -2.0, 2.0)
    # no segment is too long for its predecessor
    apart = np.abs(np.diff(points, axis=0)).max(axis=1) > 0.8
    points = points[np.append(True, apart)]
    path = through(at_rest((0.0, 0.0)), points[:2], LIMITS, clamped=False)
    for known in range(3, len(points) + 1):
        kept = path.knots[: len(path.knots.u) - int(rng.integers(2))]
        path = through(kept, points[len(kept.u) - 1 : known], LIMITS)
        assert not path.outside(LIMITS).any()


def test_steep_knot_before_a_limit_bends_away_from_it() -> None:
    """A level end without curvature would pass the limit before it."""
    for side in (1.0, -1.0):
        zeros = np.zeros((2, 2))
        kept = Knots(
            np.array([0.0, 0.3]),
            side * np.array([[0.8, 0.0], [1.5, 0.0]]),
            side * np.array([[2.0, 0.0], [4.0, 0.0]]),
            zeros,
        )
        path = through(kept, side * np.array([[2.0, 1.9]]), LIMITS)
        assert path.knots.first[-1, 0] == 0.0
        assert side * path.knots.second[-1, 0] < 0.0
        assert path.knots.second[-1, 1] == 0.0
        assert not path.outside(LIMITS).any()


@given(st.integers(1, 40), st.integers(0, 1000))
def test_pentadiagonal_solver_solves(size: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    lower = np.eye(size)
    for offset in (1, 2):
        if size > offset:
            lower += np.diag(rng.normal(size=size - offset) * 0.5, -offset)
    matrix = lower @ np.diag(rng.uniform(0.5, 2.0, size)) @ lower.T
    bands = []
    for offset in range(3):
        band = np.zeros(size)
        if size > offset:
            band[: size - offset] = np.diag(matrix, offset)
        bands.append(band)
    right = rng.normal(size=size)
    diagonal, first, second = bands
    solution = solve_pentadiagonal(diagonal, first, second, right)
    assert solution is not None
    assert matrix @ solution == pytest.approx(right, abs=1e-6)


def test_pentadiagonal_solver_returns_none_for_an_indefinite_matrix() -> None:
    assert solve_pentadiagonal(np.array([1.0, -1.0]), np.zeros(2), np.zeros(2), np.ones(2)) is None


def test_stop_that_would_leave_the_range_is_made_per_joint() -> None:
    slow_joint_limits = JointLimits(
        LIMITS.names,
        LIMITS.position_min,
        LIMITS.position_max,
        LIMITS.velocity,
        np.array([20.0, 2.0]),
        np.array([200.0, 20.0]),
    )
    state = (np.array([1.7, 0.0]), np.array([2.5, 1.5]), np.zeros(2))
    stop = fastest_stop(slow_joint_limits, state)
    assert stop.within(slow_joint_limits)


def test_move_that_would_leave_the_range_is_not_returned() -> None:
    state = (np.array([1.99, 0.0]), np.array([3.0, 0.0]), np.zeros(2))
    assert fastest_move(LIMITS, state, np.array([0.0, 0.0])) is None


@pytest.mark.parametrize('size', [2, 3, 4, 7, 64, 101])
def test_tridiagonal_solver_solves(size: int) -> None:
    rng = np.random.default_rng(size)
    below, above = 10.0 ** rng.uniform(-4.0, 2.0, (2, size, 6))
    below[0] = above[-1] = 0.0
    main = 2.0 * (below + above)
    right = rng.normal(size=(size, 6))
    solution = solve_tridiagonal(below, main, above, right)
    for column in range(6):
        dense = np.diag(main[:, column])
        dense += np.diag(below[1:, column], -1) + np.diag(above[:-1, column], 1)
        expected = np.linalg.solve(dense, right[:, column])
        assert solution[:, column] == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_memory_of_a_path_grows_linearly_with_its_points() -> None:
    """A dense matrix of the spline alone would take 128 MB."""
    s = np.linspace(0.0, 2.0, 4001)[:, None]
    points = np.hstack([np.sin(s), np.cos(s)])
    tracemalloc.start()
    through(at_rest((0.0, 1.0)), points[1:], LIMITS, clamped=False)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 25e6
