# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fastest motion through known waypoints, compared with ipopt's.

Invariant 2 of docs/invariants.md: every limit holds at every instant.
"""

from functools import cache
from itertools import pairwise, product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.examples import one_in
from support.smoother_harness import ARM, SLOW

from benchmark.exact_extrema import exact_extrema
from benchmark.family_members import FAMILIES, LONG_FAMILIES, members
from benchmark.limit_sets import FACTORS, limit_set
from benchmark.references import References, digest
from benchmark.strategies import stop_and_go
from benchmark.trajectories import benchmark_set
from epson_driver.motion import Array, JointLimits, smooth
from epson_driver.motion.closest_samples import closest_sample_indices
from epson_driver.motion.fastest import BEND_RATIO, MIN_BEND, fastest
from epson_driver.motion.joint_motion import JointMotion
from epson_driver.motion.smoother import MERGE_TOLERANCE
from epson_driver.motion.smoother.path import Knots, through
from epson_driver.motion.transcription import Search

pytestmark = pytest.mark.invariant(2)

OPTIMUM_RATIO, WORST_RATIO = 1.004, 1.01
"""Permitted ratio to the duration of ipopt's motion, on average and at most."""

ZIGZAG = np.random.default_rng(5).uniform(-1.2, 1.2, (7, 3))
"""Distant points in the middle of the slow arm's range."""


def merged(positions: Array) -> Array:
    """Return the points without those close to their predecessor, and the last point."""
    kept = [positions[0]]
    for position in positions[1:]:
        if np.abs(position - kept[-1]).max() >= MERGE_TOLERANCE:
            kept.append(position)
    return np.array(kept)


def assert_within(motion: JointMotion, limits: JointLimits, start: Array) -> None:
    """Assert every limit by the polynomials, independently of the package's check."""
    executed: Any = SimpleNamespace(executed=[(0.0, motion)], now=motion.duration, limits=limits)
    result = exact_extrema(executed, start)
    assert result.worst <= 1.0 + 1e-6
    assert result.outside <= 1e-10
    assert max(result.position_jump, result.velocity_jump, result.acceleration_jump) <= 1e-9


def test_tiny_jerk_causes_no_overflow() -> None:
    """Searches produce such jerks, and 1 / 1e-310 is not finite."""
    state, limits = (np.zeros(1), np.ones(1), np.full(1, -1.0)), limit_set('full')
    for jerk in (1e-310, -1e-310):
        motion = JointMotion(state, np.ones((1, 1)), np.full((1, 1), jerk))
        with np.errstate(all='raise', under='ignore'):
            (lowest,), (highest,) = motion.extent
            speed, _, _ = motion.limit_usage(limits)
        assert (lowest, highest) == pytest.approx((0.0, 0.5))
        assert speed == pytest.approx(1.0 / limits.velocity.min())


def passes(motion: JointMotion, waypoints: Array) -> Array:
    """Return the distance of each waypoint from its closest node in order, shape (k,)."""
    nodes = motion.states[0].T
    missed: Array = np.abs(nodes[closest_sample_indices(waypoints, nodes)] - waypoints).max(axis=1)
    return missed


@cache
def cases() -> dict[str, tuple[Array, JointLimits, float]]:
    references, known = References(), {}
    for name, trajectory in product(FACTORS, benchmark_set()):
        limits = limit_set(name)
        result = references[digest(trajectory.positions, limits)]
        if 'ipopt' in result.opt_by:
            known[f'{trajectory.name}-{name}'] = trajectory.positions, limits, result.opt
    return known


@pytest.mark.parametrize(
    ('max_points', 'min_count'),
    [(40, 14), pytest.param(1000, 28, marks=pytest.mark.slow)],
)
def test_motion_is_as_fast_as_the_optimum_of_another_solver(
    max_points: int, min_count: int
) -> None:
    ratios = []
    for positions, limits, optimum in cases().values():
        if len(positions) > max_points:
            continue
        waypoints = merged(positions)
        motion = fastest(waypoints, limits)
        assert motion is not None
        assert_within(motion, limits, waypoints[0])
        assert passes(motion, waypoints).max() <= 1e-8
        ratios.append(motion.duration / optimum)
    assert len(ratios) >= min_count
    assert np.exp(np.mean(np.log(ratios))) <= OPTIMUM_RATIO
    assert max(ratios) <= WORST_RATIO


@pytest.mark.parametrize(
    'seeds', [range(31_000, 31_001), pytest.param(range(32_000, 32_002), marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    'family', one_in(6, [name for name in FAMILIES if name not in LONG_FAMILIES])
)
def test_motion_is_found_through_any_points(family: str, seeds: range) -> None:
    for member in members(family, seeds):
        waypoints = merged(member.positions)
        motion = fastest(waypoints, member.limits)
        assert motion is not None
        assert_within(motion, member.limits, waypoints[0])
        assert passes(motion, waypoints).max() <= 1e-8
        assert motion.duration < stop_and_go(member.positions, member.limits).duration


@pytest.mark.parametrize(
    'seeds', [range(4), pytest.param(range(100, 108), marks=pytest.mark.slow)]
)
def test_slow_arms_on_long_segments_respect_their_velocity(seeds: range) -> None:
    """A segment then takes far longer than a ramp, and velocity peaks between nodes."""
    for seed in seeds:
        rng = np.random.default_rng(seed)
        joints, count = int(rng.integers(1, 8)), int(rng.integers(3, 16))
        velocity = 10.0 ** rng.uniform(-0.7, 0.9) * 10.0 ** rng.uniform(-0.4, 0.4, joints)
        acceleration = velocity * 10.0 ** rng.uniform(0.2, 1.7, joints)
        jerk = acceleration * 10.0 ** rng.uniform(0.2, 1.9, joints)
        reach = 10.0 ** rng.uniform(-2.0, 0.7, joints)
        names = tuple(f'joint_{i}' for i in range(joints))
        limits = JointLimits(names, -reach, reach, velocity, acceleration, jerk)
        waypoints = rng.uniform(-reach, reach, (count, joints))
        motion = fastest(waypoints, limits, float(rng.choice([0.0, 0.01])))
        assert motion is not None
        assert_within(motion, limits, waypoints[0])
        assert motion.duration <= 1.01 * stop_and_go(waypoints, limits).duration


def test_many_points_without_times_are_smoothed() -> None:
    """`smooth` once gave them times of its own that passed the longest duration of a plan."""
    points = np.linspace(ZIGZAG[0], ZIGZAG[1], 120)
    motion = smooth(points, SLOW)
    assert np.abs(motion.positions[-1] - ZIGZAG[1]).max() <= 1e-9


def test_motion_bends_little_more_than_the_spline() -> None:
    zeros = np.zeros((1, 3))
    knots = Knots(np.zeros(1), ZIGZAG[:1], zeros, zeros)
    spline = through(knots, ZIGZAG[1:], SLOW, False, True)
    motion = fastest(ZIGZAG, SLOW)
    assert motion is not None
    nodes = motion.states[0].T
    indices = [int(np.abs(nodes - waypoint).max(axis=1).argmin()) for waypoint in ZIGZAG]
    u = spline.knots.u
    for i, (begin, end) in enumerate(pairwise(ZIGZAG)):

        def farthest(places: Array, begin: Array = begin, chord: Array = end - begin) -> float:
            along = np.clip((places - begin) @ chord / (chord @ chord), 0.0, 1.0)
            return float(np.abs(places - begin - along[:, None] * chord).max())

        allowed = farthest(spline.sample(np.linspace(u[i], u[i + 1], 201))[0])
        bend = farthest(nodes[indices[i] : indices[i + 1] + 1])
        assert bend <= 1.02 * max(BEND_RATIO * allowed, MIN_BEND)


@pytest.mark.parametrize(
    'name', one_in(2, ['around_pillar_fast_100ms-half', 'moveit_10_percent-half'])
)
def test_larger_tolerance_gives_a_faster_motion(name: str) -> None:
    positions, limits, _ = cases()[name]
    waypoints, before = merged(positions), np.inf
    for tolerance in (0.0, 0.002, 0.005, 0.01, 0.05, 0.2):
        motion = fastest(waypoints, limits, tolerance)
        assert motion is not None
        assert_within(motion, limits, waypoints[0])
        missed = passes(motion, waypoints)
        assert missed.max() <= 1.01 * tolerance + 1e-8
        assert max(missed[0], missed[-1]) <= 1e-8
        assert motion.duration <= 1.002 * before
        before = motion.duration


def test_order_of_close_points_is_preserved() -> None:
    points = np.concatenate([ZIGZAG[:3], ZIGZAG[2] + 0.002 * np.arange(1, 4)[:, None]])
    motion = fastest(points, SLOW, 0.5)
    assert motion is not None
    near = np.abs(np.diff(points, axis=0)).max(axis=1)
    allowed = 0.25 * np.minimum(near[:-1], near[1:])
    assert np.all(passes(motion, points)[1:-1] <= 1.01 * allowed)


def test_waypoint_at_a_position_limit_is_reached() -> None:
    points = ZIGZAG.copy()
    points[2, 0], points[4, 1] = SLOW.position_max[0], SLOW.position_min[1]
    for tolerance in (0.0, 0.1):
        motion = fastest(points, SLOW, tolerance)
        assert motion is not None
        assert_within(motion, SLOW, points[0])
        assert passes(motion, points)[[2, 4]].max() <= 1e-8


def test_corners_of_a_box_take_no_longer_than_with_stops() -> None:
    square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    for size in (0.002, 0.05, 0.8):
        corners = 0.1 + size * square
        motion = smooth(corners, SLOW)
        stops = stop_and_go(corners, SLOW).duration
        assert motion.duration <= stops + 0.004


def test_motion_on_the_spline_is_the_fallback(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    spline = smooth(ZIGZAG, SLOW, refine=False)
    assert smooth(ZIGZAG, SLOW).duration < spline.duration
    monkeypatch.setattr('epson_driver.motion.fastest.MAX_INTERVALS', 5)
    assert smooth(ZIGZAG, SLOW).positions.tolist() == spline.positions.tolist()


def test_failed_search_leaves_the_motion_on_the_spline(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def singular(search: Search) -> bool:
        raise np.linalg.LinAlgError('made for this test')

    spline = smooth(ZIGZAG, SLOW, refine=False)
    for step in (singular, lambda search: False):
        monkeypatch.setattr(Search, 'step', step)
        assert smooth(ZIGZAG, SLOW).positions.tolist() == spline.positions.tolist()


@pytest.mark.slow
def test_look_ahead_or_unrefined_spline_excludes_a_tolerance() -> None:
    settings: list[dict[str, Any]] = [{'look_ahead': 1.0}, {'refine': False}]
    for options in settings:
        assert smooth(ZIGZAG, SLOW, **options).duration > smooth(ZIGZAG, SLOW).duration
        with pytest.raises(ValueError, match=r'path_tolerance = 0.01 rad: .* with a look-ahead'):
            smooth(ZIGZAG, SLOW, path_tolerance=0.01, **options)


@pytest.mark.parametrize('value', [-0.001, 0.51, float('nan'), float('inf')])
def test_invalid_tolerance_is_rejected(value: float) -> None:
    with pytest.raises(ValueError, match=r'path_tolerance = .* rad: must be 0 … 0.5'):
        smooth(np.zeros((3, 6)), ARM, path_tolerance=value)
