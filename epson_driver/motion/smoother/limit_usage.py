# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Usage of the limits by a plan. Every plan must pass this verification.

A plan has a path, with the path parameter u, and a timing u(t). The verification is valid at every
instant, not only at samples. The motion is divided into spans at the ends of the timing's pieces
and at the path's knots. In a span, the path is one polynomial of u, and the timing one polynomial
of the time. So the joints' positions are polynomials of degree 15, and their derivatives of degree
14, 13 and 12. A polynomial is within the range of its Bernstein coefficients, called its hull
(Farouki, Rajan 1987). The first and last coefficients are its values at the ends. A span whose
hull exceeds a limit is halved until the result is certain.
"""

from dataclasses import dataclass
from math import comb

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.path import DEGREE, Path
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation

BACKWARD_SPEED = 1e-9
"""Negative speed u̇ that counts as rounding instead of a reversal."""

LIMIT_TOLERANCE_SHARE = 1e-7
"""Relative excess of a velocity, acceleration or jerk limit that counts as rounding."""

POSITION_TOLERANCE = 1e-12
"""Excess of a position limit that counts as rounding, rad."""

JUMP_TOLERANCE = 1e-9
"""Jump of u between two pieces of a timing that counts as rounding."""

KNOT_TOLERANCE = 1e-12
"""Difference in u between a path knot and an end of a timing's piece that counts as rounding."""

PASSAGE_TOLERANCE = 1e-15
"""Accuracy with which the passage of a knot is computed, in u or in s."""

MAX_HALVINGS = 16
"""Maximum number of times that a span is halved. After that, its hull counts as its usage."""

TIGHT_HULL_RATIO = 1.02
"""A span that exceeds a limit at one end is not halved if its hull is at most this multiple of the
value there."""

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class LimitUsage:
    """Usage of the limits by a timing on a path, in each of m spans.

    * positions: path parameter u in the middle of each span, shape (m,).
    * velocity, acceleration, jerk: upper bounds for all joints, as multiples of the limits, shape
      (m,).
    * inside: whether every joint stays within its position limits, and the timing never jumps and
      never reverses.
    """

    positions: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    inside: bool

    @property
    def allowed(self) -> bool:
        """Whether all limits are respected."""
        return self.inside and bool(
            max(self.velocity.max(), self.acceleration.max(), self.jerk.max())
            <= 1.0 + LIMIT_TOLERANCE_SHARE
        )


def limit_usage(path: Path, timing: TimeParametrisation, limits: JointLimits) -> LimitUsage:
    """Return the usage of the limits by a timing on a path, from its start to its end."""
    spans = _spans(path, timing)
    confined = _confined(path, limits)
    inside = _forward(timing) and _continuous(timing)
    parts: list[tuple[Array, Array]] = []
    for halvings_left in range(MAX_HALVINGS, -1, -1):
        used = _span_usage(path, spans, limits, confined)
        undecided = used.undecided & (halvings_left > 0)
        inside = inside and not bool(np.any(used.outside & ~undecided))
        parts.append((used.middles[~undecided], used.hull[~undecided]))
        if not undecided.any():
            break
        spans = spans[undecided].halves()
    middles = np.concatenate([middle for middle, _ in parts])
    velocity, acceleration, jerk = np.concatenate([hull for _, hull in parts]).T
    return LimitUsage(middles, velocity, acceleration, jerk, inside)


@dataclass(frozen=True, slots=True, eq=False)
class _Spans:
    """m intervals of time, each with one piece of the timing on one segment of the path.

    All fields have shape (m,).

    * segment: index of the path segment.
    * offset: u at the start of the span, measured from the segment's first knot.
    * speed, acceleration, jerk: derivatives of u by time at the start of the span.
    * duration: duration of the span, s.
    """

    segment: Indices
    offset: Array
    speed: Array
    acceleration: Array
    jerk: Array
    duration: Array

    def __getitem__(self, some: npt.NDArray[np.bool_]) -> '_Spans':
        return _Spans(
            self.segment[some],
            self.offset[some],
            self.speed[some],
            self.acceleration[some],
            self.jerk[some],
            self.duration[some],
        )

    def halves(self) -> '_Spans':
        """Return the first halves of all spans, then the second halves."""
        t = self.duration / 2.0
        v, a, j = self.speed, self.acceleration, self.jerk
        return _Spans(
            np.tile(self.segment, 2),
            np.append(self.offset, self.offset + _distance(t, v, a, j)),
            np.append(v, v + t * (a + t * j / 2.0)),
            np.append(a, a + t * j),
            np.tile(j, 2),
            np.tile(t, 2),
        )


def _distance(t: Array, v: Array, a: Array, j: Array) -> Array:
    """Return the increase of u in time t, from speed v and acceleration a, at constant jerk j."""
    distance: Array = t * (v + t * (a / 2.0 + t * j / 6.0))
    return distance


def _spans(path: Path, timing: TimeParametrisation) -> _Spans:
    """Return the spans of a timing on a path.

    A span's path segment is found by counting the knots before it, because u may be rounded.
    """
    durations = np.diff(timing.times)
    reached = np.maximum.accumulate(timing.positions)
    knots = path.knots.u
    before, end = np.searchsorted(knots, (reached[0], reached[-1]), side='right')
    first = int(np.clip(before - 1, 0, len(knots) - 2))
    last = int(np.clip(end - 1, first, len(knots) - 2))
    passed = np.arange(first + 1, last + 1)
    # a knot closer to a breakpoint than KNOT_TOLERANCE counts as at it
    within = reached.searchsorted(knots[passed] + KNOT_TOLERANCE, side='right') - 1
    within = np.clip(within, 0, len(durations) - 1)
    since = np.zeros(len(passed))
    inside = reached[within] < knots[passed] - KNOT_TOLERANCE
    since[inside] = _passages(timing, within[inside], knots[passed[inside]])
    # every span starts at a breakpoint of the timing, or at a knot
    count = len(durations)
    piece = np.append(np.arange(count), within)
    start = np.append(np.zeros(count), since)
    knot = np.append(np.zeros(count, dtype=np.intp), np.ones(len(passed), dtype=np.intp))
    order = np.lexsort((knot, start, piece))
    piece, start, knot = piece[order], start[order], knot[order]
    segment = first + np.cumsum(knot)
    until = durations[piece]
    until[:-1] = np.where(piece[1:] == piece[:-1], start[1:], until[:-1])
    v, a, j = timing.velocities[piece], timing.accelerations[piece], timing.jerks[piece]
    offset = np.where(
        knot == 1, 0.0, timing.positions[piece] - knots[segment] + _distance(start, v, a, j)
    )
    spans = _Spans(
        segment,
        offset,
        v + start * (a + start * j / 2.0),
        a + start * j,
        j,
        until - start,
    )
    return spans[spans.duration > 0.0]


def _passages(timing: TimeParametrisation, piece: Indices, us: Array) -> Array:
    """Return the time from the start of each `piece` until it reaches path parameter `us`, s."""
    distances = us - timing.positions[piece]
    durations = timing.times[piece + 1] - timing.times[piece]
    v, a, j = timing.velocities[piece], timing.accelerations[piece], timing.jerks[piece]
    low, high = np.zeros_like(durations), durations.copy()
    t = durations / 2.0
    for _ in range(100):  # Newton's method, with bisection if it leaves the bracket
        over = _distance(t, v, a, j) - distances
        high, low = np.where(over > 0.0, t, high), np.where(over > 0.0, low, t)
        if np.all((np.abs(over) <= PASSAGE_TOLERANCE) | (high - low <= PASSAGE_TOLERANCE)):
            break
        with np.errstate(divide='ignore', invalid='ignore'):
            better = t - over / (v + t * (a + t * j / 2.0))
        middle = (low + high) / 2.0
        t = np.where((better > low) & (better < high), better, middle)
    return t


def _forward(timing: TimeParametrisation) -> bool:
    """Return whether a timing never reverses."""
    v, a, j = timing.velocities[:-1], timing.accelerations[:-1], timing.jerks
    with np.errstate(divide='ignore', invalid='ignore'):
        turn = np.nan_to_num(-a / j, nan=0.0, posinf=0.0, neginf=0.0)
    turn = np.clip(turn, 0.0, np.diff(timing.times))
    lowest = v + turn * (a + turn * j / 2.0)
    return bool(min(lowest.min(), timing.velocities.min()) >= -BACKWARD_SPEED)


def _continuous(timing: TimeParametrisation) -> bool:
    """Return whether each piece of a timing ends at the start of the next one, or at rest."""
    t = np.diff(timing.times)
    v, a, j = timing.velocities[:-1], timing.accelerations[:-1], timing.jerks
    gaps = (
        timing.positions[:-1] + _distance(t, v, a, j) - timing.positions[1:],
        v + t * (a + t * j / 2.0) - timing.velocities[1:],
        a + t * j - timing.accelerations[1:],
    )
    largest = float(np.max(np.abs(timing.accelerations)))
    return bool(
        t.min() >= 0.0
        and np.max(np.abs(gaps[0])) <= JUMP_TOLERANCE
        and np.max(np.abs(gaps[1])) <= LIMIT_TOLERANCE_SHARE
        and np.max(np.abs(gaps[2])) <= LIMIT_TOLERANCE_SHARE * max(largest, 1.0)
        and timing.velocities[-1] == 0.0 == timing.accelerations[-1]
    )


def _bernstein(derivative: int) -> Array:
    """Return the matrix that turns a polynomial into a derivative's Bernstein coefficients.

    The polynomial of s, 0 ≤ s ≤ 1, is given by its coefficients of s¹ … s¹⁵. derivative: the order
    of the derivative. The result has shape (15, 16 - derivative).
    """
    size = 3 * DEGREE
    degree = size - derivative
    matrix = np.zeros((size, degree + 1))
    for n in range(max(derivative, 1), size + 1):
        factor = float(np.prod(np.arange(n, n - derivative, -1.0)))
        k = n - derivative
        for i in range(k, degree + 1):
            matrix[n - 1, i] = factor * comb(i, k) / comb(degree, k)
    return matrix


_POSITION = _bernstein(0)
_DERIVATIVES = np.concatenate([_bernstein(order) for order in (1, 2, 3)], axis=1)
_PARTS = np.cumsum([0] + [3 * DEGREE + 1 - order for order in (1, 2, 3)])


def _powers(spans: _Spans) -> tuple[Array, Array]:
    """Return the powers w, w² … w⁵ of the increase w(s) of u since the start of each span.

    s is the elapsed fraction of the span's duration. A power is given by its coefficients of
    s¹ … s¹⁵, so the shape is (m, 5, 15). The second result is w(1/2), shape (m,).
    """
    t = spans.duration
    linear = spans.speed * t
    square = spans.acceleration * t**2 / 2.0
    cube = spans.jerk * t**3 / 6.0
    powers = np.zeros((len(t), DEGREE, 3 * DEGREE))
    powers[:, 0, 0], powers[:, 0, 1], powers[:, 0, 2] = linear, square, cube
    linear, square, cube = linear[:, None], square[:, None], cube[:, None]
    for n in range(1, DEGREE):
        previous, power = powers[:, n - 1, n - 1 : 3 * n], powers[:, n]
        power[:, n : 3 * n + 1] += linear * previous
        power[:, n + 1 : 3 * n + 2] += square * previous
        power[:, n + 2 : 3 * n + 3] += cube * previous
    return powers, _distance(t / 2.0, spans.speed, spans.acceleration, spans.jerk)


@dataclass(frozen=True, slots=True, eq=False)
class _SpanUsage:
    """Usage of the limits in m spans.

    * middles: path parameter u in the middle of each span, shape (m,).
    * hull: upper bounds of velocity, acceleration and jerk, as multiples of the limits, (m, 3).
    * outside: whether a position may exceed its limits, shape (m,).
    * undecided: whether halving the span could change these results, shape (m,).
    """

    middles: Array
    hull: Array
    outside: npt.NDArray[np.bool_]
    undecided: npt.NDArray[np.bool_]


def _span_usage(
    path: Path, spans: _Spans, limits: JointLimits, confined: npt.NDArray[np.bool_]
) -> _SpanUsage:
    powers, half = _powers(spans)
    taylor = path.taylor(spans.segment, spans.offset).transpose(0, 2, 1)  # (m, n, 6)
    t = spans.duration
    # one small product for each span, because BLAS would start threads for a large one
    coefficients = taylor[:, :, 1:] @ (powers @ _DERIVATIVES)  # (m, n, 15 + 14 + 13)
    np.abs(coefficients, out=coefficients)
    most_by_s = np.maximum.reduceat(coefficients, _PARTS[:-1], axis=2)  # (m, n, 3)
    at_ends = np.maximum(coefficients[:, :, _PARTS[:-1]], coefficients[:, :, _PARTS[1:] - 1])
    limit = np.stack([limits.velocity, limits.acceleration, limits.jerk], axis=1)
    scale = np.stack([t, t**2, t**3], axis=1)
    hull = (most_by_s / limit).max(axis=1) / scale
    ends = (at_ends / limit).max(axis=1) / scale
    upper = 1.0 + LIMIT_TOLERANCE_SHARE
    exceeded = (ends > upper) & (hull <= TIGHT_HULL_RATIO * ends)
    undecided = np.any((hull > upper) & ~exceeded, axis=1)
    outside = np.zeros(len(t), dtype=bool)
    open_ = np.flatnonzero(~confined[spans.segment])
    if len(open_):
        positions = taylor[open_, :, :1] + taylor[open_, :, 1:] @ (powers[open_] @ _POSITION)
        excess = np.maximum(
            limits.position_min[:, None] - positions, positions - limits.position_max[:, None]
        ).max(axis=1)
        outside[open_] = excess.max(axis=1) > POSITION_TOLERANCE
        certain = np.maximum(excess[:, 0], excess[:, -1]) > POSITION_TOLERANCE
        undecided[open_] |= outside[open_] & ~certain
    middles = path.knots.u[spans.segment] + spans.offset + half
    return _SpanUsage(middles, hull, outside, undecided)


def _confined(path: Path, limits: JointLimits) -> npt.NDArray[np.bool_]:
    """Return which segments are certainly within the position limits, shape (k - 1,)."""
    hulls = path.hulls()
    within = (hulls >= limits.position_min) & (hulls <= limits.position_max)
    confined: npt.NDArray[np.bool_] = np.all(within, axis=(1, 2))
    return confined
