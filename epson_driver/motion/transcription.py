# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fastest motion through knots as one problem in time, and an interior-point method for it.

Each of the m intervals between two knots (`ways` in the code) has STEPS steps of constant jerk and
equal duration. The unknowns are the state of each joint at the knots, the jerks, the duration h of
each interval, and the place on the chord of each node (an end of a step), next to which the node
should be. The sum of all h is minimised, subject to

    state at the next knot = state at this knot, integrated with the jerks
    |jerk| ≤ J in each step, |acceleration| ≤ A at each node, |velocity| ≤ V
    |position - place on the chord| ≤ bend at each node, in each joint

The equations are linearised and used to eliminate the jerks, except the jerks without effect on
the next knot. Primal and dual variables have separate step lengths (Nocedal, Wright: Numerical
Optimization, 2006, chapter 19). The unknowns of a single interval are eliminated within it, joint
by joint, which leaves a block-tridiagonal system with the states at one knot and one h per block.

Joint positions are scaled by the distance per second at the velocity limit, so that V is 1.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.banded import solve_block_tridiagonal

STEPS = 4
"""Steps per interval. With three, the states at its ends would determine every jerk."""

LEAST_SHARE = 0.02
"""Minimum duration of an interval, as a share of its initial duration."""

FIRST_JERK_SHARE = 0.9
"""Maximum initial jerk, as a share of the limit."""

GAP = 1e-2
"""Convergence tolerance of the relative time that could still be gained."""

ROW_TOLERANCE = 2e-3
"""Convergence tolerance of the excess of a row."""

STATE_TOLERANCE = 1e-2
"""Convergence tolerance of the defect of a state: the share of the jerk limit that corrects it."""

MAX_CHANGE = 0.3
"""Maximum relative change of a duration in one step."""

STIFFNESS = 1.0
"""Cost of changing all durations in one step, relative to the time to be gained. It is needed
because many changes of them are equally good."""

PLACE_STIFFNESS = 1e-4
"""The same cost for the places on the chord, which may have no effect."""

BORDER = 1e-6
"""A joint at a waypoint closer than this to the limit of its range, in s, rests there."""

_EPSILON = 1e-6
_FREE = 1e3
"""Width of the range of an inactive row, so that the row limits nothing."""

_OWN = 7
"""Number of columns for the states at both knots and h. The places on the chord and the jerks
follow them."""


@dataclass(frozen=True, eq=False)
class Problem:
    """m intervals of n joints, in rad (or m).

    start, chord: the straight line between two waypoints that contains the interval, shape (m, n).
    bend: maximum distance from this line, shape (m,). tolerance: maximum distance of a knot from
    its initial position, shape (m + 1,), and np.inf at knots that are no waypoints.
    """

    limits: JointLimits
    start: Array
    chord: Array
    bend: Array
    tolerance: Array


class _Nodes:
    """Linear map from the state at the start of an interval and its jerks to its rows, for h = 1.

    For another h, each coefficient is multiplied by h to the power of its exponent. The rows are,
    in this order: accelerations at the inner nodes, the inner Bernstein coefficient of the
    velocity in each step (the velocity stays in the hull of these), positions at all nodes except
    the first, both inner coefficients of the position if the range is near, and position,
    velocity and acceleration at the last node.
    """

    def __init__(self, bounded: bool) -> None:
        t = 1.0 / STEPS
        step = np.array([[1.0, t, t * t / 2.0], [0.0, 1.0, t], [0.0, 0.0, 1.0]])
        node = np.concatenate([np.eye(3), np.zeros((3, STEPS))], axis=1)
        nodes = [node]
        for k in range(STEPS):
            node = step @ node
            node[:, 3 + k] += (t**3 / 6.0, t * t / 2.0, t)
            nodes.append(node)
        rows = [(item[2], 2) for item in nodes[1:-1]]
        rows += [(item[1] + t / 2.0 * item[2], 1) for item in nodes[:-1]]
        self.positions = slice(STEPS + len(rows), STEPS + len(rows) + STEPS)
        rows += [(item[0], 0) for item in nodes[1:]]
        if bounded:
            rows += [(item[0] + t / 3.0 * item[1], 0) for item in nodes[:-1]]
            rows += [(item[0] - t / 3.0 * item[1], 0) for item in nodes[1:]]
        self.count = len(rows)
        rows += [(nodes[-1][order], order) for order in range(3)]
        order = np.array([order for _, order in rows])[:, None]
        table = np.array([row for row, _ in rows])
        self.by_state, self.by_jerk = table[:, :3], table[:, 3:]
        self.state_exponents = np.where(self.by_state != 0.0, np.arange(3) - order, 0)
        self.jerk_exponents = np.repeat(3 - order, STEPS, axis=1)
        self.inverse = np.linalg.pinv(nodes[-1][:, 3:])
        """Map from the state at the end to the smallest jerks that cause it."""
        self.neutral = np.linalg.svd(nodes[-1][:, 3:])[2][3:].T
        """Jerks without effect on the state at the end, shape (STEPS, STEPS - 3)."""


class Search:
    """The current iterate and its Newton steps.

    knots: shape (m + 1, n, 3). durations: shape (m,). jerks: shape (m, n, STEPS).
    """

    def __init__(self, problem: Problem, knots: Array, durations: Array) -> None:
        limits, scale = problem.limits, problem.limits.velocity
        self._scale = scale
        self._x, self._h = knots / scale[:, None], durations.copy()
        self._a, self._j = limits.acceleration / scale, limits.jerk / scale
        self._start, self._chord = problem.start / scale, problem.chord / scale
        self._least = LEAST_SHARE * durations
        low, high = limits.position_min / scale, limits.position_max / scale
        bend = problem.bend[:, None] / scale
        ends = np.stack([self._start, self._start + self._chord])
        bounded = bool(np.any((ends - bend < low) | (ends + bend > high)))
        self._nodes = _Nodes(bounded)
        m, n = bend.shape
        self._size = (m, n)

        nodes = self._nodes
        self._jerks = np.zeros((m, n, STEPS))
        self._follow()
        upper = FIRST_JERK_SHARE * self._j[:, None]
        self._jerks = np.clip(-self._missing @ _turned(self._inverse()), -upper, upper)
        self._follow()
        self._places = self._nearest(problem.chord)

        self._width = np.ones((m, n, STEPS + nodes.count))
        self._centre = np.zeros_like(self._width)
        self._width[:, :, :STEPS] = self._j[:, None]
        self._width[:, :, STEPS : 2 * STEPS - 1] = self._a[:, None]
        last = nodes.positions.stop - 1
        self._width[:, :, nodes.positions] = bend[:, :, None]
        self._width[np.isfinite(problem.tolerance[1:]), :, last] = _FREE
        on_border = (problem.tolerance == 0.0)[:, None] & (
            (self._x[:, :, 0] < low + BORDER) | (self._x[:, :, 0] > high - BORDER)
        )
        if bounded:
            self._width[:, :, last + 1 :] = (high - low)[:, None] / 2.0
            self._centre[:, :, last + 1 :] = (high + low)[:, None] / 2.0
            self._width[on_border[:-1], last + 1] = _FREE
            self._width[on_border[1:], -1] = _FREE
            self._x[on_border, 1] = 0.0
        self._knot_width = np.stack(
            [np.full((m, n), _FREE), np.ones((m, n)), np.tile(self._a, (m, 1))], 2
        )
        beside = np.isfinite(problem.tolerance) & (problem.tolerance > 0.0)
        self._knot_width[beside[1:], :, 0] = problem.tolerance[beside][:, None] / scale
        self._knot_centre = np.zeros((m, n, 3))
        self._knot_centre[:, :, 0] = self._x[1:, :, 0]
        own = np.arange(n)[:, None] * 3 + np.arange(3)
        self._at_knot, self._at_both = own, np.concatenate([own, 3 * n + 1 + own], axis=1)
        """Indices of each joint's states in the system of an interval."""
        self._changes = np.ones((m + 1, n, 3), dtype=bool)
        self._changes[[0, -1]] = False
        self._changes[problem.tolerance == 0.0, :, 0] = False
        self._changes[on_border, 1] = False

        rows = self._rows()
        self._slack = np.maximum(np.stack([1.0 - rows, 1.0 + rows]), 0.1)
        self._mu = 1.0 / self._slack.size
        self._dual = self._mu / self._slack
        self._gap = self._excess = self._missed = np.inf

    @property
    def converged(self) -> bool:
        """Whether the gap, the excess of the rows and the state defects are within tolerance."""
        return (
            self._gap < 1.5 * GAP
            and self._excess < ROW_TOLERANCE
            and self._missed < STATE_TOLERANCE
        )

    @property
    def duration(self) -> float:
        """The sum of all durations, s."""
        return float(self._h.sum())

    def found(self) -> tuple[Array, Array]:
        """Return the jerks from knot to knot, shape (m, n, STEPS), rad/s³, and the durations."""
        jerks = self._jerks - self._missing @ _turned(self._inverse())
        return jerks * self._scale[:, None], self._h

    def _follow(self) -> None:
        """Compute the states at the nodes, their derivatives by h, and the defects at knots."""
        nodes, h = self._nodes, self._h[:, None, None]
        self._by_state = nodes.by_state * h**nodes.state_exponents
        self._by_jerk = nodes.by_jerk * h**nodes.jerk_exponents
        start, jerks = self._x[:-1], self._jerks
        self._states = start @ _turned(self._by_state) + jerks @ _turned(self._by_jerk)
        self._by_h = start @ _turned(self._by_state * (nodes.state_exponents / h))
        self._by_h += jerks @ _turned(self._by_jerk * (nodes.jerk_exponents / h))
        self._missing = self._states[:, :, nodes.count :] - self._x[1:]

    def _nearest(self, chord: Array) -> Array:
        """Return the place on the chord nearest to each node, shape (m, STEPS), 0 … 1."""
        positions = slice(self._nodes.positions.start - STEPS, self._nodes.positions.stop - STEPS)
        since = (self._states[:, :, positions] - self._start[:, :, None]) * self._scale[:, None]
        along: Array = (since * chord[:, :, None]).sum(axis=1) / (chord**2).sum(axis=1)[:, None]
        return along.clip(0.02, 0.98)

    def _rows(self) -> Array:
        """Return the rows: all must be within ± 1."""
        nodes = self._nodes
        rows = np.concatenate([self._jerks, self._states[:, :, : nodes.count]], axis=2)
        rows[:, :, nodes.positions] -= (
            self._start[:, :, None] + self._chord[:, :, None] * self._places[:, None, :]
        )
        at_knots = (self._x[1:] - self._knot_centre) / self._knot_width
        return np.concatenate(
            [
                ((rows - self._centre) / self._width).ravel(),
                at_knots.ravel(),
                (2.0 * self._places - 1.0).ravel(),
                self._least / self._h,
            ]
        )

    def step(self) -> bool:
        """Take a Newton step and return whether that was possible.

        Raises LinAlgError if a system has no solution.
        """
        m, n = self._size
        jerks, missing = self._by_unknowns()
        tangents, ahead = self._tangents(jerks, missing)
        rows = self._rows()
        then = rows.copy()
        then[: ahead.size] += ahead.ravel()
        stiffness = self._dual / self._slack
        push = self._mu / self._slack + self._dual + stiffness * np.stack([then - 1, -then - 1])
        ends = np.cumsum([ahead.size, 3 * m * n, m * STEPS])
        weights = np.split(stiffness.sum(axis=0), ends)
        forces = np.split(push[0] - push[1], ends)

        own, right, neutral = self._without_neutral(tangents, weights[0], forces[0])
        ways, sums, places = self._without_places(own, right, weights, forces)
        solved = self._at_knots(ways, sums, weights[1], forces[1])
        if solved is None:
            return False
        # back substitution
        of_h = 3 * n
        by_x, by_h = solved[:, self._at_knot], solved[:-1, of_h]
        known = np.concatenate([solved[:-1], solved[1:, :of_h]], axis=1)[..., None]
        by_place = -(places[:, :, :-1] @ known)[..., 0] - places[:, :, -1]
        shared = _OWN + STEPS
        change = np.empty((m, n, tangents.shape[3]))
        change[..., :3], change[..., 3:6] = by_x[:-1], by_x[1:]
        change[..., 6], change[..., _OWN:shared] = by_h[:, None], by_place[:, None]
        change[..., shared:] = -(neutral[..., :-1] @ change[..., :shared, None])[..., 0]
        change[..., shared:] -= neutral[..., -1]
        of_rows = np.concatenate(
            [
                ((tangents @ change[..., None])[..., 0] + ahead).ravel(),
                (by_x[1:] / self._knot_width).ravel(),
                2.0 * by_place.ravel(),
                -self._least / self._h**2 * by_h,
            ]
        )
        by_jerk = (jerks @ change[..., None])[..., 0] + missing
        self._go(rows, of_rows, (by_x, by_h, by_jerk, by_place))
        return True

    def _inverse(self) -> Array:
        """Return the map from the defects at the knots to the least jerks, shape (m, STEPS, 3)."""
        powers: Array = self._h[:, None, None] ** -np.array([3.0, 2.0, 1.0])
        return self._nodes.inverse * powers

    def _by_unknowns(self) -> tuple[Array, Array]:
        """Return the derivatives of the jerks by an interval's unknowns, and their corrections."""
        m, n = self._size
        end, inverse, neutral = (
            slice(self._nodes.count, None),
            self._inverse(),
            self._nodes.neutral,
        )
        jerks = np.zeros((m, n, STEPS, _OWN + STEPS + neutral.shape[1]))
        jerks[..., :3] = -(inverse @ self._by_state[:, end])[:, None]
        jerks[..., 3:6] = inverse[:, None]
        jerks[..., 6] = -self._by_h[:, :, end] @ _turned(inverse)
        jerks[..., _OWN + STEPS :] = neutral
        return jerks, -self._missing @ _turned(inverse)

    def _tangents(self, jerks: Array, missing: Array) -> tuple[Array, Array]:
        """Return the derivatives of the rows by the unknowns, and the change by the defects."""
        (m, n), count, positions = self._size, self._nodes.count, self._nodes.positions
        tangents = np.empty((m, n, STEPS + count, jerks.shape[3]))
        tangents[:, :, :STEPS] = jerks
        tangents[:, :, STEPS:] = self._by_jerk[:, None, :count] @ jerks
        tangents[:, :, STEPS:, :3] += self._by_state[:, None, :count]
        tangents[:, :, STEPS:, 6] += self._by_h[:, :, :count]
        place = np.arange(STEPS)
        tangents[:, :, positions.start + place, _OWN + place] -= self._chord[:, :, None]
        tangents /= self._width[..., None]
        others = missing @ _turned(self._by_jerk[:, :count])
        return tangents, np.concatenate([missing, others], axis=2) / self._width

    def _without_neutral(
        self, tangents: Array, weights: Array, forces: Array
    ) -> tuple[Array, Array, Array]:
        """Eliminate the neutral jerks per joint. Return the reduced system and their solution."""
        shape, shared = (*tangents.shape[:3], 1), _OWN + STEPS
        across = _turned(tangents)
        own = across @ (tangents * weights.reshape(shape))
        right = (across @ forces.reshape(shape))[..., 0]
        free = own[..., shared:, shared:]
        free += (_EPSILON / self._j**2)[:, None, None] * np.eye(free.shape[-1])
        between = own[..., shared:, :shared]
        neutral = np.linalg.solve(
            free, np.concatenate([between, right[..., shared:, None]], axis=3)
        )
        less = _turned(between) @ neutral
        return (
            own[..., :shared, :shared] - less[..., :-1],
            right[..., :shared] - less[..., -1],
            neutral,
        )

    def _without_places(
        self, own: Array, right: Array, weights: list[Array], forces: list[Array]
    ) -> tuple[Array, Array, Array]:
        """Eliminate the places on the chord. Return an interval's system and their solution."""
        (m, n), at, reach = self._size, self._at_both, self._least / self._h**2
        size, of_h, place = 6 * n + 1, 3 * n, np.arange(STEPS)
        ways, sums = np.zeros((m, size, size)), np.zeros((m, size))
        ways[:, at[:, :, None], at[:, None, :]] = own[..., :6, :6]
        ways[:, at, of_h] = ways[:, of_h, at] = own[..., :6, 6]
        ways[:, of_h, of_h] = own[..., 6, 6].sum(axis=1) + weights[3] * reach**2
        ways[:, of_h, of_h] += STIFFNESS / m / self._h**2
        sums[:, at] = right[..., :6]
        sums[:, of_h] = right[..., 6].sum(axis=1) + 1.0 / self.duration - forces[3] * reach
        beside = own[..., _OWN:, _OWN:].sum(axis=1)
        beside[:, place, place] += 4.0 * weights[2].reshape(m, STEPS) + PLACE_STIFFNESS
        others = np.zeros((m, STEPS, size + 1))
        others[:, :, at] = own[..., _OWN:, :6].transpose(0, 2, 1, 3)
        others[:, :, of_h] = own[..., _OWN:, 6].sum(axis=1)
        others[:, :, -1] = right[..., _OWN:].sum(axis=1) + 2.0 * forces[2].reshape(m, STEPS)
        places = np.linalg.solve(beside, others)
        less = _turned(others[:, :, :-1]) @ places
        return ways - less[:, :, :-1], sums - less[:, :, -1], places

    def _at_knots(self, ways: Array, sums: Array, weights: Array, forces: Array) -> Array | None:
        """Return the change of the states at the knots and of h, shape (m + 1, 3 n + 1)."""
        (m, n), own = self._size, self._at_knot
        size, of_h = 3 * n + 1, 3 * n
        diagonal, right = np.zeros((m + 1, size, size)), np.zeros((m + 1, size))
        diagonal[:-1], right[:-1] = ways[:, :size, :size], sums[:, :size]
        diagonal[1:, :of_h, :of_h] += ways[:, size:, size:]
        right[1:, :of_h] += sums[:, size:]
        beyond = np.zeros((m, size, size))
        beyond[:, :, :of_h] = ways[:, :size, size:]
        diagonal[1:, own, own] += weights.reshape(m, n, 3) / self._knot_width**2
        right[1:, own] += forces.reshape(m, n, 3) / self._knot_width
        scales = np.stack([np.full(n, 1e-2), np.ones(n), self._a], axis=1)
        diagonal[:, own, own] += _EPSILON / scales**2
        changes = np.ones((m + 1, size), dtype=bool)
        changes[:, own] = self._changes
        changes[-1, of_h] = False
        diagonal *= changes[:, :, None] & changes[:, None, :]
        diagonal[:, np.arange(size), np.arange(size)] += ~changes
        beyond *= changes[:-1, :, None] & changes[1:, None, :]
        solved = -solve_block_tridiagonal(diagonal, beyond, right * changes)
        return solved if np.all(np.isfinite(solved)) else None

    def _go(self, rows: Array, of_rows: Array, change: tuple[Array, Array, Array, Array]) -> None:
        """Advance along a step as far as the slacks, the duals and the durations allow."""
        slack, dual = self._slack, self._dual
        d_slack = np.stack([1.0 - rows - of_rows, 1.0 + rows + of_rows]) - slack
        d_dual = (self._mu - slack * dual - dual * d_slack) / slack
        by_x, by_h, by_jerk, by_place = change
        farthest = float((np.abs(by_h) / self._h).max())
        ahead = min(_longest(slack, d_slack), MAX_CHANGE / max(farthest, 1e-12))
        dual_ahead = _longest(dual, d_dual)
        self._x = self._x + ahead * by_x
        self._h = self._h + ahead * by_h
        self._jerks = self._jerks + ahead * by_jerk
        self._places = self._places + ahead * by_place
        self._dual = dual + dual_ahead * d_dual
        self._follow()
        rows = self._rows()
        self._slack = np.maximum(slack + ahead * d_slack, np.stack([1.0 - rows, 1.0 + rows]))
        self._gap = float((self._slack * self._dual).sum())
        self._excess = float(np.abs(rows).max()) - 1.0
        missed = np.abs(self._missing @ _turned(self._inverse()))
        self._missed = float((missed / self._j[:, None]).max())
        lower = 0.15 if min(ahead, dual_ahead) > 0.7 else 0.5
        self._mu = max(lower * self._gap, GAP) / self._slack.size


def _longest(values: Array, changes: Array) -> float:
    """Return the longest step ≤ 1 that leaves a hundredth of each positive value."""
    fastest = float((changes / values).min())
    return 1.0 if fastest >= 0.0 else min(1.0, -0.99 / fastest)


def _turned(matrices: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return each matrix transposed."""
    return matrices.swapaxes(-1, -2)
