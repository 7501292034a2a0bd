# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fastest motion through knots as an optimisation problem, and an interior-point solver.

Knots are the waypoints and points between them. Each of the m intervals between two knots has
STEPS steps of constant jerk and equal duration. Nodes are the ends of the steps. The chord is the
straight line between two waypoints.

The unknowns are the state (position, velocity, acceleration) of each joint at the knots, the
jerks, the duration h of each interval, and for each node a place, which is a fraction of the
chord. The sum of all h is minimised, subject to

    state at the next knot = state at this knot, integrated with the jerks
    |jerk| ≤ J in each step, |acceleration| ≤ A at each node, |velocity| ≤ V
    |position - place on the chord| ≤ bend at each node, in each joint

J, A and V are the limits of the joint. The inequalities are called rows. The equations are
linearised, and eliminate all jerks except the neutral ones. (Neutral jerks are combinations of
jerks that have no effect on the state at the next knot.) Primal and dual variables have separate
step lengths (Nocedal, Wright: Numerical Optimization, 2006, chapter 19). Unknowns that belong to a
single interval are eliminated for each interval and joint. This leaves a block-tridiagonal system.
Each of its blocks has the states at one knot and one h.

The solver divides the positions of a joint by its velocity limit, so that V is 1.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.banded import solve_block_tridiagonal

STEPS = 4
"""Steps per interval. With only three, the states at both knots would determine every jerk."""

MIN_DURATION_SHARE = 0.02
"""Minimum duration of an interval, as a fraction of its initial duration."""

FIRST_JERK_SHARE = 0.9

GAP = 1e-2
"""Tolerance for convergence: the fraction of the duration that could still be saved."""

ROW_TOLERANCE = 2e-3
"""Tolerance for convergence: the relative excess of a row over its bound."""

STATE_TOLERANCE = 1e-2
"""Tolerance for convergence: the jerk that would correct a state, relative to the limit."""

MAX_CHANGE = 0.3
"""Maximum relative change of a duration in one iteration."""

STIFFNESS = 1.0
"""Cost of changing the durations, which selects one of many equally good changes of them."""

PLACE_STIFFNESS = 1e-4
"""Cost of changing the places on the chord, which may have no effect on the duration."""

LIMIT_MARGIN = 1e-6
"""Scaled distance of a waypoint from a position limit below which the joint has no velocity."""

_EPSILON = 1e-6
"""Penalty on changes of the states and jerks, which keeps the linear systems regular."""

_FREE = 1e3
"""Half the width of a row's range, so large that the row has no effect."""

_PLACE = 7
"""Index of the first place among a joint's unknowns in an interval: both states and h precede."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Constraints of m intervals of n joints, in rad (or m).

    * start, chord: start of each interval's chord, and vector to the chord's end, shape (m, n).
    * bend: maximum distance of the motion from the chord, shape (m,).
    * tolerance: maximum distance of a knot from its initial position, shape (m + 1,). It is np.inf
      at a knot that is no waypoint.
    """

    limits: JointLimits
    start: Array
    chord: Array
    bend: Array
    tolerance: Array


class _Nodes:
    """Linear map from the state at the start of an interval, and its jerks, to its rows.

    The coefficients (`by_state`, `by_jerk`) apply to h = 1. For another h, each coefficient is
    multiplied by h to the power of its exponent. The rows are, in this order:

    * the accelerations at the inner nodes,
    * the inner Bernstein coefficient of the velocity in each step,
    * the positions at all nodes except the first,
    * if `bounded`, i.e. near a position limit, both inner Bernstein coefficients of the position
      in each step,
    * the state at the last node.

    A polynomial is within the range of its Bernstein coefficients.
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
        """Map from a change of the state at the end to the smallest jerks that cause it."""
        self.neutral = np.linalg.svd(nodes[-1][:, 3:])[2][3:].T
        """Combinations of jerks without effect on the final state, shape (STEPS, STEPS - 3)."""


class Search:
    """The interior-point iteration, from initial knot states, (m + 1, n, 3), and durations, s."""

    def __init__(self, problem: Problem, knots: Array, durations: Array) -> None:
        limits, scale = problem.limits, problem.limits.velocity
        self._scale = scale
        self._x, self._h = knots / scale[:, None], durations.copy()
        self._a, self._j = limits.acceleration / scale, limits.jerk / scale
        self._start, self._chord = problem.start / scale, problem.chord / scale
        self._min_durations = MIN_DURATION_SHARE * durations
        low, high = limits.position_min / scale, limits.position_max / scale
        bend = problem.bend[:, None] / scale
        ends = np.stack([self._start, self._start + self._chord])
        bounded = bool(np.any((ends - bend < low) | (ends + bend > high)))
        self._nodes = _Nodes(bounded)
        m, n = bend.shape
        self._size = (m, n)

        nodes = self._nodes
        self._jerks = np.zeros((m, n, STEPS))
        self._integrate()
        upper = FIRST_JERK_SHARE * self._j[:, None]
        self._jerks = np.clip(-self._defects @ _transposed(self._inverse()), -upper, upper)
        self._integrate()
        self._places = self._nearest_places(problem.chord)

        self._width = np.ones((m, n, STEPS + nodes.count))
        self._centre = np.zeros_like(self._width)
        self._width[:, :, :STEPS] = self._j[:, None]
        self._width[:, :, STEPS : 2 * STEPS - 1] = self._a[:, None]
        last = nodes.positions.stop - 1
        self._width[:, :, nodes.positions] = bend[:, :, None]
        self._width[np.isfinite(problem.tolerance[1:]), :, last] = _FREE
        at_limit = (problem.tolerance == 0.0)[:, None] & (
            (self._x[:, :, 0] < low + LIMIT_MARGIN) | (self._x[:, :, 0] > high - LIMIT_MARGIN)
        )
        if bounded:
            self._width[:, :, last + 1 :] = (high - low)[:, None] / 2.0
            self._centre[:, :, last + 1 :] = (high + low)[:, None] / 2.0
            self._width[at_limit[:-1], last + 1] = _FREE
            self._width[at_limit[1:], -1] = _FREE
            self._x[at_limit, 1] = 0.0
        self._knot_width = np.stack(
            [np.full((m, n), _FREE), np.ones((m, n)), np.tile(self._a, (m, 1))], 2
        )
        movable = np.isfinite(problem.tolerance) & (problem.tolerance > 0.0)
        self._knot_width[movable[1:], :, 0] = problem.tolerance[movable][:, None] / scale
        self._knot_centre = np.zeros((m, n, 3))
        self._knot_centre[:, :, 0] = self._x[1:, :, 0]
        states = np.arange(n)[:, None] * 3 + np.arange(3)
        self._at_knot, self._at_both = states, np.concatenate([states, 3 * n + 1 + states], axis=1)
        """Indices in an interval's system of each joint's state at its first knot, and at both."""
        self._changes = np.ones((m + 1, n, 3), dtype=bool)
        self._changes[[0, -1]] = False
        self._changes[problem.tolerance == 0.0, :, 0] = False
        self._changes[at_limit, 1] = False

        rows = self._rows()
        self._slack = np.maximum(np.stack([1.0 - rows, 1.0 + rows]), 0.1)
        self._mu = 1.0 / self._slack.size
        self._dual = self._mu / self._slack
        self._gap = self._excess = self._max_defect = np.inf

    @property
    def converged(self) -> bool:
        return (
            self._gap < 1.5 * GAP
            and self._excess < ROW_TOLERANCE
            and self._max_defect < STATE_TOLERANCE
        )

    @property
    def duration(self) -> float:
        return float(self._h.sum())

    def result(self) -> tuple[Array, Array]:
        """Return the jerks, shape (m, n, STEPS), rad/s³, and the durations, shape (m,), s."""
        jerks = self._jerks - self._defects @ _transposed(self._inverse())
        return jerks * self._scale[:, None], self._h

    def _integrate(self) -> None:
        """Set the states at the nodes, and the defects: integrated states minus unknown states."""
        nodes, h = self._nodes, self._h[:, None, None]
        self._by_state = nodes.by_state * h**nodes.state_exponents
        self._by_jerk = nodes.by_jerk * h**nodes.jerk_exponents
        start, jerks = self._x[:-1], self._jerks
        self._states = start @ _transposed(self._by_state) + jerks @ _transposed(self._by_jerk)
        self._by_h = start @ _transposed(self._by_state * (nodes.state_exponents / h))
        self._by_h += jerks @ _transposed(self._by_jerk * (nodes.jerk_exponents / h))
        self._defects = self._states[:, :, nodes.count :] - self._x[1:]

    def _nearest_places(self, chord: Array) -> Array:
        """Return the place on the chord nearest to each node, shape (m, STEPS), [0, 1]."""
        positions = slice(self._nodes.positions.start - STEPS, self._nodes.positions.stop - STEPS)
        offset = (self._states[:, :, positions] - self._start[:, :, None]) * self._scale[:, None]
        along: Array = (offset * chord[:, :, None]).sum(axis=1) / (chord**2).sum(axis=1)[:, None]
        return along.clip(0.02, 0.98)

    def _rows(self) -> Array:
        """Return the values of all rows, scaled so that each must be within ± 1."""
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
                self._min_durations / self._h,
            ]
        )

    def step(self) -> bool:
        """Take a Newton step. Return False, or raise LinAlgError, if it has no finite solution."""
        m, n = self._size
        jerks, corrections = self._by_unknowns()
        tangents, offsets = self._tangents(jerks, corrections)
        rows = self._rows()
        predicted = rows.copy()
        predicted[: offsets.size] += offsets.ravel()
        stiffness = self._dual / self._slack
        push = (
            self._mu / self._slack
            + self._dual
            + stiffness * np.stack([predicted - 1, -predicted - 1])
        )
        ends = np.cumsum([offsets.size, 3 * m * n, m * STEPS])
        weights = np.split(stiffness.sum(axis=0), ends)
        forces = np.split(push[0] - push[1], ends)

        matrices, right, neutral = self._without_neutral(tangents, weights[0], forces[0])
        systems, right_sides, places = self._without_places(matrices, right, weights, forces)
        solved = self._solve_knots(systems, right_sides, weights[1], forces[1])
        if solved is None:
            return False
        # back substitution
        of_h = 3 * n
        by_x, by_h = solved[:, self._at_knot], solved[:-1, of_h]
        knot_changes = np.concatenate([solved[:-1], solved[1:, :of_h]], axis=1)[..., None]
        by_place = -(places[:, :, :-1] @ knot_changes)[..., 0] - places[:, :, -1]
        shared = _PLACE + STEPS
        change = np.empty((m, n, tangents.shape[3]))
        change[..., :3], change[..., 3:6] = by_x[:-1], by_x[1:]
        change[..., 6], change[..., _PLACE:shared] = by_h[:, None], by_place[:, None]
        change[..., shared:] = -(neutral[..., :-1] @ change[..., :shared, None])[..., 0]
        change[..., shared:] -= neutral[..., -1]
        of_rows = np.concatenate(
            [
                ((tangents @ change[..., None])[..., 0] + offsets).ravel(),
                (by_x[1:] / self._knot_width).ravel(),
                2.0 * by_place.ravel(),
                -self._min_durations / self._h**2 * by_h,
            ]
        )
        by_jerk = (jerks @ change[..., None])[..., 0] + corrections
        self._advance(rows, of_rows, (by_x, by_h, by_jerk, by_place))
        return True

    def _inverse(self) -> Array:
        powers: Array = self._h[:, None, None] ** -np.array([3.0, 2.0, 1.0])
        return self._nodes.inverse * powers

    def _by_unknowns(self) -> tuple[Array, Array]:
        """Return the derivatives of the jerks with respect to the unknowns, and jerk corrections.

        The corrections make the integrated states equal to the unknown states (see `_integrate`).
        """
        m, n = self._size
        end, inverse = slice(self._nodes.count, None), self._inverse()
        neutral = self._nodes.neutral
        jerks = np.zeros((m, n, STEPS, _PLACE + STEPS + neutral.shape[1]))
        jerks[..., :3] = -(inverse @ self._by_state[:, end])[:, None]
        jerks[..., 3:6] = inverse[:, None]
        jerks[..., 6] = -self._by_h[:, :, end] @ _transposed(inverse)
        jerks[..., _PLACE + STEPS :] = neutral
        return jerks, -self._defects @ _transposed(inverse)

    def _tangents(self, jerks: Array, corrections: Array) -> tuple[Array, Array]:
        """Return the derivatives of the rows with respect to the unknowns, and the rows' offsets.

        The offsets are the changes of the rows that the jerk corrections cause (`_by_unknowns`).
        """
        (m, n), count, positions = self._size, self._nodes.count, self._nodes.positions
        tangents = np.empty((m, n, STEPS + count, jerks.shape[3]))
        tangents[:, :, :STEPS] = jerks
        tangents[:, :, STEPS:] = self._by_jerk[:, None, :count] @ jerks
        tangents[:, :, STEPS:, :3] += self._by_state[:, None, :count]
        tangents[:, :, STEPS:, 6] += self._by_h[:, :, :count]
        place = np.arange(STEPS)
        tangents[:, :, positions.start + place, _PLACE + place] -= self._chord[:, :, None]
        tangents /= self._width[..., None]
        by_correction = corrections @ _transposed(self._by_jerk[:, :count])
        return tangents, np.concatenate([corrections, by_correction], axis=2) / self._width

    def _without_neutral(
        self, tangents: Array, weights: Array, forces: Array
    ) -> tuple[Array, Array, Array]:
        """Eliminate the neutral jerks. Return the systems, and the maps to the neutral jerks."""
        shape, shared = (*tangents.shape[:3], 1), _PLACE + STEPS
        transposed = _transposed(tangents)
        matrices = transposed @ (tangents * weights.reshape(shape))
        right = (transposed @ forces.reshape(shape))[..., 0]
        free = matrices[..., shared:, shared:]
        free += (_EPSILON / self._j**2)[:, None, None] * np.eye(free.shape[-1])
        coupling = matrices[..., shared:, :shared]
        neutral = np.linalg.solve(
            free, np.concatenate([coupling, right[..., shared:, None]], axis=3)
        )
        reduction = _transposed(coupling) @ neutral
        return (
            matrices[..., :shared, :shared] - reduction[..., :-1],
            right[..., :shared] - reduction[..., -1],
            neutral,
        )

    def _without_places(
        self, matrices: Array, right: Array, weights: list[Array], forces: list[Array]
    ) -> tuple[Array, Array, Array]:
        """Eliminate the places. Return each interval's system, and the maps to its places."""
        (m, n), indices, slopes = self._size, self._at_both, self._min_durations / self._h**2
        size, of_h, place = 6 * n + 1, 3 * n, np.arange(STEPS)
        systems, right_sides = np.zeros((m, size, size)), np.zeros((m, size))
        systems[:, indices[:, :, None], indices[:, None, :]] = matrices[..., :6, :6]
        systems[:, indices, of_h] = systems[:, of_h, indices] = matrices[..., :6, 6]
        systems[:, of_h, of_h] = matrices[..., 6, 6].sum(axis=1) + weights[3] * slopes**2
        systems[:, of_h, of_h] += STIFFNESS / m / self._h**2
        right_sides[:, indices] = right[..., :6]
        right_sides[:, of_h] = right[..., 6].sum(axis=1) + 1.0 / self.duration - forces[3] * slopes
        by_place = matrices[..., _PLACE:, _PLACE:].sum(axis=1)
        by_place[:, place, place] += 4.0 * weights[2].reshape(m, STEPS) + PLACE_STIFFNESS
        coupled = np.zeros((m, STEPS, size + 1))
        coupled[:, :, indices] = matrices[..., _PLACE:, :6].transpose(0, 2, 1, 3)
        coupled[:, :, of_h] = matrices[..., _PLACE:, 6].sum(axis=1)
        coupled[:, :, -1] = right[..., _PLACE:].sum(axis=1) + 2.0 * forces[2].reshape(m, STEPS)
        places = np.linalg.solve(by_place, coupled)
        reduction = _transposed(coupled[:, :, :-1]) @ places
        return systems - reduction[:, :, :-1], right_sides - reduction[:, :, -1], places

    def _solve_knots(
        self, systems: Array, right_sides: Array, weights: Array, forces: Array
    ) -> Array | None:
        """Solve for the changes of knot states and durations, (m + 1, 3 n + 1), or return None."""
        (m, n), states = self._size, self._at_knot
        size, of_h = 3 * n + 1, 3 * n
        diagonal, right = np.zeros((m + 1, size, size)), np.zeros((m + 1, size))
        diagonal[:-1], right[:-1] = systems[:, :size, :size], right_sides[:, :size]
        diagonal[1:, :of_h, :of_h] += systems[:, size:, size:]
        right[1:, :of_h] += right_sides[:, size:]
        off_diagonal = np.zeros((m, size, size))
        off_diagonal[:, :, :of_h] = systems[:, :size, size:]
        diagonal[1:, states, states] += weights.reshape(m, n, 3) / self._knot_width**2
        right[1:, states] += forces.reshape(m, n, 3) / self._knot_width
        scales = np.stack([np.full(n, 1e-2), np.ones(n), self._a], axis=1)
        diagonal[:, states, states] += _EPSILON / scales**2
        changes = np.ones((m + 1, size), dtype=bool)
        changes[:, states] = self._changes
        changes[-1, of_h] = False
        diagonal *= changes[:, :, None] & changes[:, None, :]
        diagonal[:, np.arange(size), np.arange(size)] += ~changes
        off_diagonal *= changes[:-1, :, None] & changes[1:, None, :]
        solved = -solve_block_tridiagonal(diagonal, off_diagonal, right * changes)
        return solved if np.all(np.isfinite(solved)) else None

    def _advance(
        self, rows: Array, of_rows: Array, change: tuple[Array, Array, Array, Array]
    ) -> None:
        """Advance along a Newton step as far as the slacks, the duals and the durations allow.

        of_rows: change of the rows by the whole step. change: changes of the knot states, the
        durations, the jerks and the places by the whole step.
        """
        slack, dual = self._slack, self._dual
        d_slack = np.stack([1.0 - rows - of_rows, 1.0 + rows + of_rows]) - slack
        d_dual = (self._mu - slack * dual - dual * d_slack) / slack
        by_x, by_h, by_jerk, by_place = change
        farthest = float((np.abs(by_h) / self._h).max())
        length = min(_longest(slack, d_slack), MAX_CHANGE / max(farthest, 1e-12))
        dual_length = _longest(dual, d_dual)
        self._x = self._x + length * by_x
        self._h = self._h + length * by_h
        self._jerks = self._jerks + length * by_jerk
        self._places = self._places + length * by_place
        self._dual = dual + dual_length * d_dual
        self._integrate()
        rows = self._rows()
        self._slack = np.maximum(slack + length * d_slack, np.stack([1.0 - rows, 1.0 + rows]))
        self._gap = float((self._slack * self._dual).sum())
        self._excess = float(np.abs(rows).max()) - 1.0
        corrections = np.abs(self._defects @ _transposed(self._inverse()))
        self._max_defect = float((corrections / self._j[:, None]).max())
        factor = 0.15 if min(length, dual_length) > 0.7 else 0.5
        self._mu = max(factor * self._gap, GAP) / self._slack.size


def _longest(values: Array, changes: Array) -> float:
    """Return the longest step ≤ 1 that reduces no positive value by more than 99 %.

    A step adds this multiple of `changes` to `values`.
    """
    fastest = float((changes / values).min())
    return 1.0 if fastest >= 0.0 else min(1.0, -0.99 / fastest)


def _transposed(matrices: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return matrices.swapaxes(-1, -2)
