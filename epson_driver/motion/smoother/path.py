# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A path with continuous curvature through knots in joint space.

The parameter u of the path is the sum of the chord lengths ‖Δq / v_max‖₂ between the knots. Its
unit is the second at full speed. A knot is a position with its first and second derivatives with
respect to u. Between two knots the path is the quintic polynomial with these values at its ends.
The derivatives come from a cubic spline through the knots. Where no knot is added or changed
later, the path is this spline.
"""

from dataclasses import dataclass
from itertools import product
from math import comb

import numpy as np
import numpy.typing as npt

from epson_driver.motion.interpolation import hermite
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.banded import solve_tridiagonal

DEGREE = 5


def _hull_of(start: float, end: float) -> Array:
    """Return the matrix from power to Bernstein coefficients of a quintic on [start, end]."""
    matrix = np.zeros((DEGREE + 1, DEGREE + 1))
    for i in range(DEGREE + 1):  # the blossom of sⁿ: i arguments are `end`, the others `start`
        polynomial = np.array([1.0])
        for argument in [end] * i + [start] * (DEGREE - i):
            polynomial = np.convolve(polynomial, [1.0, argument])
        for n in range(DEGREE + 1):
            matrix[i, n] = polynomial[n] / comb(DEGREE, n)
    return matrix


HULL_PARTS = 16
"""Number of parts of a segment in the check of the position limits."""

_HULL = _hull_of(0.0, 1.0)
_HULLS = np.concatenate(
    [_hull_of(i / HULL_PARTS, (i + 1) / HULL_PARTS) for i in range(HULL_PARTS)]
)

_PLACES = np.linspace(0.0, 1.0, 17)
"""Fractions of a segment at which its distance from the chord is measured."""

_BINOMIALS = np.array([[comb(n, k) for n in range(DEGREE + 1)] for k in range(DEGREE + 1)], float)
_SHIFT_EXPONENTS = np.maximum(np.subtract.outer(range(DEGREE + 1), range(DEGREE + 1)).T, 0)
"""Exponents of s in (x + s)ⁿ = Σ binomial(n, k) sⁿ⁻ᵏ xᵏ, in row k and column n."""

POSITION_TOLERANCE = 5e-13
"""Tolerance for rounding at a position limit, rad."""

AT_LIMIT_DISTANCE = 1e-6
"""Distance from a position limit, rad. A joint that is closer at a knot must not move there."""

ONWARD_SHARE = 0.25
"""Fraction of the expected next segment along which a joint must be able to move straight on from
the last knot, within its limits. A quintic with a slope at a knot overshoots by 0.19 of slope ·
length."""

LONG_SEGMENT = 1.5
"""Maximum expected length of the next segment, s at full speed."""

LONGER_RATIO = 10.0
"""Maximum ratio of the expected length of the next segment to the longest known segment."""

_FREE, _LEVEL, _TURNING = 0, 1, 2
"""State of a joint at a knot. _FREE: the spline determines its derivatives. _LEVEL: its slope is
given, usually 0. _TURNING: its slope is 0, and its curvature is just large enough to keep the
adjacent segments within the limits."""

TURN_RATIO, MIN_TURN_SHARE = 1.1, 0.25
"""TURN_RATIO: ratio of the curvature of a turning joint to the minimum curvature. With the
minimum, the fourth Bernstein coefficient is inside the limit by at least MIN_TURN_SHARE of the
third one's excess."""

_TURN_SAMPLES = np.geomspace(0.02, 50.0, 128)
"""Samples of s / (1 - s) for the search for this minimum curvature. s is the distance from the
other knot, (0, 1)."""


@dataclass(frozen=True, slots=True, eq=False)
class Knots:
    """k points of a path, with derivatives.

    u is strictly increasing, shape (k,). The other arrays have the shape (k, n).
    """

    u: Array
    position: Array
    first: Array
    second: Array

    def __getitem__(self, part: slice) -> 'Knots':
        return Knots(self.u[part], self.position[part], self.first[part], self.second[part])


class Path:
    __slots__ = ('_by_exponent', '_coefficients', '_lengths', 'knots')

    def __init__(self, knots: Knots) -> None:
        self.knots = knots
        self._lengths = np.diff(knots.u)
        h = self._lengths[:, None]
        self._coefficients = hermite(
            (knots.position[:-1], knots.first[:-1] * h, knots.second[:-1] * h**2),
            (knots.position[1:], knots.first[1:] * h, knots.second[1:] * h**2),
        )  # (k - 1, 6, n)
        self._by_exponent = np.ascontiguousarray(self._coefficients.transpose(1, 0, 2))

    @property
    def end(self) -> float:
        return float(self.knots.u[-1])

    def segment(self, u: float) -> int:
        """Return the index of the segment (and of its first knot) at path parameter u."""
        index = int(self.knots.u.searchsorted(u, side='right')) - 1
        return min(max(index, 0), len(self._lengths) - 1)

    def at(self, u: float) -> tuple[Array, Array, Array]:
        """Return position, first and second derivative at path parameter u, shapes (n,)."""
        index = self.segment(u)
        h = float(self._lengths[index])
        s = (u - float(self.knots.u[index])) / h
        s2, s3, s4 = s * s, s**3, s**4
        powers = np.array(
            [
                [1.0, s, s2, s3, s4, s4 * s],
                [0.0, 1.0 / h, 2.0 * s / h, 3.0 * s2 / h, 4.0 * s3 / h, 5.0 * s4 / h],
                [0.0, 0.0, 2.0 / h**2, 6.0 * s / h**2, 12.0 * s2 / h**2, 20.0 * s3 / h**2],
            ]
        )
        q, first, second = powers @ self._coefficients[index]
        return q, first, second

    def sample(self, us: Array, before: bool = False) -> tuple[Array, Array, Array, Array]:
        """Return position and three derivatives at the path parameters `us`, shapes (m, n).

        The third derivative may jump at a knot. The result is the value just after the knot or,
        with `before`, just before it.
        """
        after = self.knots.u.searchsorted(us, side='left' if before else 'right')
        index = np.clip(after - 1, 0, len(self._lengths) - 1)
        h = self._lengths[index]
        # one array for each coefficient, and s and h repeated for each joint, make this faster
        c0, c1, c2, c3, c4, c5 = self._by_exponent.take(index, axis=1)
        s = ((us - self.knots.u[index]) / h)[:, None].repeat(c0.shape[1], axis=1)
        h = h[:, None].repeat(c0.shape[1], axis=1)
        return (
            c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5)))),
            (c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h,
            (2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / h**2,
            (6.0 * c3 + s * (24.0 * c4 + s * 60.0 * c5)) / h**3,
        )

    def taylor(self, segment: npt.NDArray[np.intp], offset: Array) -> Array:
        """Return the coefficients of Taylor polynomials of m segments, powers 0 to 5, (m, 6, n).

        offset: u of the expansion point, measured from the segment's first knot, shape (m,).
        """
        h = self._lengths[segment]
        powers = np.vander(offset / h, DEGREE + 1, increasing=True)
        shift = powers[:, _SHIFT_EXPONENTS] * _BINOMIALS
        shift *= np.vander(1.0 / h, DEGREE + 1, increasing=True)[:, :, None]
        shifted: Array = shift @ self._coefficients[segment]
        return shifted

    def hulls(self) -> Array:
        """Return each segment's Bernstein coefficients, which bound it, shape (k - 1, 6, n)."""
        hulls: Array = _HULL @ self._coefficients
        return hulls

    def bends(self) -> Array:
        """Return each segment's maximum distance from its chord in any joint, shape (k - 1,)."""
        knots = self.knots
        us = knots.u[:-1, None] + self._lengths[:, None] * _PLACES
        chords = np.diff(knots.position, axis=0)[:, None]
        since = self.sample(us.ravel())[0].reshape(*us.shape, -1) - knots.position[:-1, None]
        along = np.clip((since * chords).sum(axis=2) / (chords**2).sum(axis=2), 0.0, 1.0)
        bends: Array = np.abs(since - along[:, :, None] * chords).max(axis=(1, 2))
        return bends

    def outside(self, limits: JointLimits) -> npt.NDArray[np.bool_]:
        """Return which joints may leave their position limits in each segment, (k - 1, n)."""
        low = limits.position_min - POSITION_TOLERANCE
        high = limits.position_max + POSITION_TOLERANCE
        hulls = self.hulls()
        beyond: npt.NDArray[np.bool_] = (hulls < low) | (hulls > high)
        outside: npt.NDArray[np.bool_] = np.any(beyond, axis=1)
        doubtful = np.flatnonzero(outside.any(axis=1))
        if len(doubtful):
            finer = _HULLS @ self._coefficients[doubtful]
            outside[doubtful] = ((finer < low) | (finer > high)).any(axis=1)
        return outside


def chord_lengths(points: Array, limits: JointLimits) -> Array:
    """Return the distances between successive points, s at full speed, shape (k - 1,).

    points: shape (k, n).
    """
    scaled: Array = np.linalg.norm(np.diff(points, axis=0) / limits.velocity, axis=1)
    return scaled


def line(knots: Knots, point: Array, limits: JointLimits) -> Path:
    """Return the straight path from the last knot to a point."""
    start = knots[len(knots.u) - 1 :]
    ends = np.stack([start.position[0], point])
    length = chord_lengths(ends, limits)
    slope = np.tile(np.diff(ends, axis=0) / length, (2, 1))
    return Path(Knots(np.append(start.u, start.u + length), ends, slope, np.zeros_like(ends)))


def in_time(knots: Knots, points: Array, times: Array, final: bool) -> Path:
    """Return the path along some knots and then through points, with the time as u.

    The path is the cubic spline of time. points: shape (m, n), m ≥ 1. times: times of the last
    knot and of the points, s, shape (m + 1,). The knots (one or more) do not change. If `final`,
    the arm rests at the last point.
    """
    chain = np.concatenate([knots.position[-1:], points])
    u = knots.u[-1] + times - times[0]
    level = np.full(chain.shape, _FREE)
    if final:
        level[-1] = _LEVEL
    neither = np.zeros(chain.shape, dtype=bool)
    start = (knots.first[-1], knots.second[-1])
    first, second = _cubic_spline(u, chain, level, np.zeros_like(chain), start, neither, neither)
    return _continued(knots, Knots(u[1:], points, first[1:], second[1:]))


def through(
    knots: Knots, points: Array, limits: JointLimits, clamped: bool = True, final: bool = False
) -> Path:
    """Return the path along some knots and then through points, shape (m, n), m ≥ 1.

    The knots (one or more) do not change. If not `clamped`, there is a single knot, at which the
    arm is at rest, and its derivatives are free. A joint that would leave its position limits
    between two points gets a slope of 0 at a point instead. After the last point, the path can
    continue within the limits. This is not needed if `final`, because the arm rests there.
    """
    chain = np.concatenate([knots.position[-1:], points])
    u = knots.u[-1] + np.concatenate(([0.0], np.cumsum(chord_lengths(chain, limits))))
    start = (knots.first[-1], knots.second[-1]) if clamped else None
    fixed = 1 if clamped else 0
    low = chain < limits.position_min + AT_LIMIT_DISTANCE
    high = chain > limits.position_max - AT_LIMIT_DISTANCE
    level = np.where(high | low, _LEVEL, _FREE)
    level[:fixed] = _FREE
    nearness = -np.minimum(chain - limits.position_min, limits.position_max - chain)
    slopes = np.zeros_like(chain)
    first, _ = _cubic_spline(u, chain, level, slopes, start, low, high)
    # the continuation after the last point must also stay within the range
    room = np.where(
        first[-1] > 0.0, limits.position_max - chain[-1], chain[-1] - limits.position_min
    )
    onward = min(LONG_SEGMENT, LONGER_RATIO * float(np.max(np.diff(u))))
    steepest = room / (ONWARD_SHARE * onward)
    steep = (np.abs(first[-1]) > steepest) & (level[-1] == _FREE) & (not final)
    level[-1, steep] = _LEVEL
    slopes[-1, steep] = (np.sign(first[-1]) * steepest)[steep]
    changed = True
    while changed:
        first, second = _cubic_spline(u, chain, level, slopes, start, low, high)
        for knot, joint in np.argwhere(level == _TURNING):
            second[knot, joint] = _turn(u, chain, first, second, knot, joint, limits)
        path = Path(Knots(u, chain, first, second))
        before, changed = level.copy(), False
        for segment, joint in np.argwhere(path.outside(limits)):
            ends = [segment, segment + 1]
            ends.sort(key=lambda knot: -nearness[knot, joint])
            # start with the knot nearer to the limit
            for step, knot in product((_LEVEL, _TURNING), ends):
                if knot >= fixed and before[knot, joint] < step:
                    level[knot, joint] = step
                    changed = True
                    break
    if clamped:
        return _continued(knots, path.knots[1:])
    return _continued(knots[: len(knots.u) - 1], path.knots)


def _continued(old: Knots, new: Knots) -> Path:
    names = ('u', 'position', 'first', 'second')
    return Path(Knots(*(np.append(getattr(old, n), getattr(new, n), axis=0) for n in names)))


def _cubic_spline(
    u: Array,
    points: Array,
    level: npt.NDArray[np.int_],
    slope: Array,
    start: tuple[Array, Array] | None,
    low: npt.NDArray[np.bool_],
    high: npt.NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Return first and second derivatives at the knots of a cubic spline, shapes (k, n).

    The second derivative is continuous at knots where a joint is _FREE. At a knot where it is
    _LEVEL or _TURNING, another spline starts, with the slope from `slope`. The curvature at this
    knot is the smaller one of both sides, or 0 if their signs differ or the joint is _TURNING. The
    curvature at the last knot is 0.

    level: state of each joint (_FREE …), shape (k, n). slope: shape (k, n). start: derivatives at
    the first knot, or None for a curvature of 0. low, high: whether a joint is at its lower or
    upper limit, shape (k, n). It must not bend out of its range there.
    """
    h = np.diff(u)[:, None]
    slopes = np.diff(points, axis=0) / h
    before, after = h[:-1], h[1:]
    # one row per knot: below · m[i - 1] + main · m[i] + above · m[i + 1] = right, for slopes m
    below, main, above = np.zeros_like(points), np.ones_like(points), np.zeros_like(points)
    right = np.zeros_like(points)
    below[1:-1], main[1:-1], above[1:-1] = after, 2.0 * (before + after), before
    right[1:-1] = 3.0 * (after * slopes[:-1] + before * slopes[1:])
    main[0] = main[-1] = 2.0
    above[0] = below[-1] = 1.0
    right[0], right[-1] = 3.0 * slopes[0], 3.0 * slopes[-1]
    if start is not None:
        main[0], above[0], right[0] = 1.0, 0.0, start[0]
    fixed = level != _FREE
    main[fixed], below[fixed], above[fixed], right[fixed] = 1.0, 0.0, 0.0, slope[fixed]
    first = solve_tridiagonal(below, main, above, right)
    first[fixed] = slope[fixed]
    second = np.zeros_like(points)
    ahead = (6.0 * slopes - 4.0 * first[:-1] - 2.0 * first[1:]) / h
    behind = (4.0 * first[1:] + 2.0 * first[:-1] - 6.0 * slopes) / h
    second[:-1], second[-1] = ahead, behind[-1]
    lesser = np.where(np.abs(ahead[1:]) < np.abs(behind[:-1]), ahead[1:], behind[:-1])
    lesser[ahead[1:] * behind[:-1] <= 0.0] = 0.0
    second[1:-1] = np.where(fixed[1:-1], lesser, second[1:-1])
    second[-1] = 0.0
    if start is None:
        second[0] = 0.0
    second[high] = np.minimum(second[high], 0.0)
    second[low] = np.maximum(second[low], 0.0)
    second[level == _TURNING] = 0.0
    if start is not None:
        first[0], second[0] = start
    return first, second


def _turn(
    u: Array,
    points: Array,
    first: Array,
    second: Array,
    knot: int,
    joint: int,
    limits: JointLimits,
) -> float:
    """Return the curvature at a knot that keeps a _TURNING joint within the nearer limit.

    It is 0, or directed inwards if the joint moves steeply towards the limit at an adjacent knot.
    points, first, second: positions and derivatives at the knots, shape (k, n).
    """
    low, high = limits.position_min[joint], limits.position_max[joint]
    border, inward = low, 1.0
    if high - points[knot, joint] < points[knot, joint] - low:
        border, inward = high, -1.0
    room = inward * (points[knot, joint] - border)
    minimum = 0.0
    for other in (knot - 1, knot + 1):
        if not 0 <= other < len(u):
            continue
        h = u[knot] - u[other]  # negative if `other` is the next knot: traverse the segment back
        # Bernstein coefficients of the distance from the limit, starting at the other knot
        start = inward * (points[other, joint] - border)
        slope = inward * first[other, joint] * h
        bend = inward * second[other, joint] * h**2
        third = start + 2.0 * slope / 5.0 + bend / 20.0
        others = start + (5.0 * start + slope) * _TURN_SAMPLES + 10.0 * third * _TURN_SAMPLES**2
        others += room * (5.0 * _TURN_SAMPLES**4 + _TURN_SAMPLES**5)
        fourth = max(float(np.max(-others / (10.0 * _TURN_SAMPLES**3))), -MIN_TURN_SHARE * third)
        minimum = max(minimum, 20.0 * (fourth - room) / h**2)
    return inward * TURN_RATIO * minimum
