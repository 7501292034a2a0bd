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
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from epson_driver.motion.interpolation import after
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.path import DEGREE, Path
from epson_driver.motion.time_parametrisation import TimeParametrisation

BACKWARD_SPEED = 1e-9
"""Maximum backward u̇ that counts as rounding instead of a reversal."""

LIMIT_TOLERANCE_SHARE = 1e-7
"""Tolerance for rounding at a velocity, acceleration or jerk limit, relative to it."""

POSITION_TOLERANCE = 1e-12
"""Tolerance for rounding at a position limit, rad."""

JUMP_TOLERANCE = 1e-9
"""Maximum jump of u between two pieces of a timing that counts as rounding."""

KNOT_TOLERANCE = 1e-12
"""Distance in u below which a path knot counts as at the end of a piece."""

PASSAGE_TOLERANCE = 1e-15
"""Accuracy of the time at which a timing passes a knot, in u or in s."""

MAX_HALVINGS = 16
"""Maximum number of halvings of a span. After it, the span's hull counts as its usage."""

TIGHT_HULL_RATIO = 1.02
"""Maximum ratio of a span's hull to its value at one end. If that value exceeds the limit, a span
with a lower ratio is not halved."""

Indices = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class LimitUsage:
    """Use of the joint limits by a motion, i.e. a timing on a path, in each of m spans.

    positions: path parameter u in the middle of each span. velocity, acceleration, jerk: highest
    value of any joint, as a multiple of its limit (upper bounds). inside: whether every joint
    stays within its position limits, and the timing never jumps and never reverses.
    """

    positions: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    inside: bool

    @property
    def allowed(self) -> bool:
        return self.inside and bool(
            max(self.velocity.max(), self.acceleration.max(), self.jerk.max())
            <= 1.0 + LIMIT_TOLERANCE_SHARE
        )


def limit_usage(path: Path, timing: TimeParametrisation, limits: JointLimits) -> LimitUsage:
    spans = _spans(path, timing)
    confined = _confined(path, limits)
    inside = _forward(timing) and _continuous(path, timing)
    parts: list[tuple[Array, Array]] = []
    for halvings_left in range(MAX_HALVINGS, -1, -1):
        middles, hull, outside, undecided = _span_usage(path, spans, limits, confined)
        undecided &= halvings_left > 0
        inside = inside and not bool(np.any(outside & ~undecided))
        parts.append((middles[~undecided], hull[~undecided]))
        if not undecided.any():
            break
        spans = spans.some(undecided).halves()
    middles, hull = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return LimitUsage(middles, hull[:, 0], hull[:, 1], hull[:, 2], inside)


class _Spans(NamedTuple):
    """m intervals of time, each with one piece of the timing on one segment of the path.

    segment: index of the path segment. offset: u at the start of the span, measured from the
    segment's first knot. speed, acceleration, jerk: time derivatives of u at the start. All
    have the shape (m,).
    """

    segment: Indices
    offset: Array
    speed: Array
    acceleration: Array
    jerk: Array
    duration: Array

    def some(self, mask: Mask) -> '_Spans':
        return _Spans._make(values[mask] for values in self)

    def halves(self) -> '_Spans':
        """Return the first halves of all spans, then the second halves."""
        t = self.duration / 2.0
        v, a, j = self.speed, self.acceleration, self.jerk
        first, second = self._replace(duration=t), after(t, self.offset, v, a, j)
        return _Spans._make(map(np.append, first, (self.segment, *second, j, t)))


def _distance(t: Array, v: Array, a: Array, j: Array) -> Array:
    distance: Array = t * (v + t * (a / 2.0 + t * j / 6.0))
    return distance


def _spans(path: Path, timing: TimeParametrisation) -> _Spans:
    """Return the spans of a motion, divided at the knots and at the timing's breakpoints."""
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
    _, speed, acceleration = after(start, np.zeros(len(start)), v, a, j)
    spans = _Spans(segment, offset, speed, acceleration, j, until - start)
    return spans.some(spans.duration > 0.0)


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
    v, a, j = timing.velocities[:-1], timing.accelerations[:-1], timing.jerks
    with np.errstate(divide='ignore', invalid='ignore'):
        turn = np.nan_to_num(-a / j, nan=0.0, posinf=0.0, neginf=0.0)
    turn = np.clip(turn, 0.0, np.diff(timing.times))
    lowest = v + turn * (a + turn * j / 2.0)
    return bool(min(lowest.min(), timing.velocities.min()) >= -BACKWARD_SPEED)


def _continuous(path: Path, timing: TimeParametrisation) -> bool:
    """Return whether each piece of a timing ends where the next starts, and the last at rest.

    At the end of a path that ends at rest itself, u̇ may jump.
    """
    t = np.diff(timing.times)
    v, a, j = timing.velocities[:-1], timing.accelerations[:-1], timing.jerks
    gaps = (
        timing.positions[:-1] + _distance(t, v, a, j) - timing.positions[1:],
        v + t * (a + t * j / 2.0) - timing.velocities[1:],
        a + t * j - timing.accelerations[1:],
    )
    largest = float(np.max(np.abs(timing.accelerations)))
    if timing.end == path.end and not (path.knots.first[-1].any() or path.knots.second[-1].any()):
        gaps[1][-1] = 0.0
    return bool(
        t.min() >= 0.0
        and np.max(np.abs(gaps[0])) <= JUMP_TOLERANCE
        and np.max(np.abs(gaps[1])) <= LIMIT_TOLERANCE_SHARE
        and np.max(np.abs(gaps[2])) <= LIMIT_TOLERANCE_SHARE * max(largest, 1.0)
        and timing.velocities[-1] == 0.0 == timing.accelerations[-1]
    )


def _bernstein(derivative: int) -> Array:
    """Return the matrix that turns a polynomial into a derivative's Bernstein coefficients.

    The polynomial is given by its coefficients of s¹ … s¹⁵, 0 ≤ s ≤ 1. Shape (15, 16 -
    derivative).
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
    """Return the powers w … w⁵ of the increase w(s) of u in each span, and w(1/2).

    s is the elapsed fraction of the span. A power is represented by its coefficients of s¹ … s¹⁵,
    shape (m, 5, 15).
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


def _span_usage(
    path: Path, spans: _Spans, limits: JointLimits, confined: Mask
) -> tuple[Array, Array, Mask, Mask]:
    """Return the middles of spans, their hulls, and two masks of the spans.

    The hulls are upper bounds of velocity, acceleration and jerk, as multiples of the limits,
    shape (m, 3). The first mask marks the spans in which a position may exceed its limits. The
    second mask marks the spans that must be halved to decide whether they respect the limits.
    """
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
    return middles, hull, outside, undecided


def _confined(path: Path, limits: JointLimits) -> Mask:
    """Return which segments are certainly within the position limits, shape (k - 1,)."""
    hulls = path.hulls()
    within = (hulls >= limits.position_min) & (hulls <= limits.position_max)
    confined: Mask = np.all(within, axis=(1, 2))
    return confined
