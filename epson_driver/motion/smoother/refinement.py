# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A better path through the same waypoints: the derivatives at its knots that take the least time.

A cubic spline knows nothing of limits. Here the derivatives at the knots (and, within a tolerance,
their positions) are found together with the speed x(u) = u̇², by the method of `interior_point`:
for a given speed the limits are linear in the path's derivatives, for a given path they are what
they are there, and each step goes towards what the tangents to both allow. The speed is a spline
with few nodes, and nothing is verified: the path is worth something only once a proposer has found
a faster timing on it.

Parameters and units are those of `refinement_rows`.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array
from epson_driver.motion.smoother import optimal
from epson_driver.motion.smoother.effort import REFINEMENT_ROW_US, REFINEMENT_STEP_US
from epson_driver.motion.smoother.path import Knots, Path
from epson_driver.motion.smoother.problem import Problem
from epson_driver.motion.smoother.refinement_rows import (
    PARAMETERS,
    Freedom,
    PathRows,
    side_rows,
)
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.smoother.speed_spline import SpeedSpline, basis
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation

NODE_SPACING_S, MAX_NODES = 0.016, 80
"""Time between the nodes of the speed's spline, s, unless there are too many."""

MAX_STEPS = 30
GAP_TOLERANCE, ROW_TOLERANCE = 2e-2, 5e-3
"""When to stop: on what more time could be gained, relative, and on the limits."""

HOPELESS_GAP = 1e3
"""A search begins with 1, and what rises so far does not come back."""

DAMPING = 1e-3
"""Cost of a change in one step: many parameters of a path are as good as each other."""

MAX_CHANGE = 0.3
"""The most that a parameter may change in one step, in its unit."""

MAX_PRODUCT = 200_000
"""Of multiplications in one product of matrices."""

_KINDS = 4
"""Rows of each joint at each sample: velocity, acceleration, and jerk to both sides."""

_SAMPLES = np.array([0.02, 0.98])


def refined(
    problem: Problem,
    bounds: SpeedBounds,
    timing: TimeParametrisation,
    freedom: Freedom,
    spacing: float | None = None,
) -> Path | None:
    """Return a path that should take less time than the problem's, or None.

    timing: one on the problem's path, from the problem's start to its end, to begin with.
    spacing: time between the nodes of the speed's spline, s.
    """
    if spacing is None:
        spacing = max(NODE_SPACING_S, timing.duration / MAX_NODES)
    spline = optimal.spline_of(problem, bounds, timing, spacing)
    if spline is None or not freedom.free.any():
        return None
    search = _Search(problem, spline, freedom)
    for _ in range(MAX_STEPS):
        problem.effort.spend(REFINEMENT_STEP_US + REFINEMENT_ROW_US * search.size)
        if problem.effort.used_up or not search.step():
            return None
        if search.converged:
            return search.path
    return None


class _Search:
    """The state of the search, and its steps.

    Unknown are c coefficients of x, and f free parameters of each joint, joint after joint. Rows
    are first those at m samples, shape (4, n, m), then those in the parameters alone, to both
    sides, shape (2, n, r). All must be ≤ 0.
    """

    def __init__(self, problem: Problem, spline: SpeedSpline, freedom: Freedom) -> None:
        path, limits = problem.path, problem.limits
        self._knots, self._velocity = path.knots, limits.velocity
        u = path.knots.u
        h = np.diff(u)
        near = np.minimum(np.append(h, h[-1]), np.append(h[0], h))
        self._units = np.stack([near, np.ones_like(near), 1.0 / near], axis=1)  # (k, 3)
        places = np.stack([path.knots.position, path.knots.first, path.knots.second], axis=1)
        self._values = (places / self._velocity / self._units[:, :, None]).reshape(3 * len(u), -1)
        self._free = np.flatnonzero(freedom.free.ravel())

        nodes, lengths = spline.nodes, spline.lengths
        us = (nodes[:-1, None] + lengths[:, None] * _SAMPLES).ravel()
        interval = np.repeat(np.arange(len(lengths)), 2)
        self._rows = PathRows(us, u, self._units)
        self._basis = basis(lengths, interval, np.tile(_SAMPLES, len(lengths)))
        self._three = interval[:, None] + np.arange(3)
        # as `optimal` has it: the velocity in the middle, the acceleration from one side each
        back = np.zeros_like(us)
        back[1::2] = (_SAMPLES[1] - 0.5) * lengths
        self._shift = np.stack([np.ones_like(us), -back, back**2 / 2.0])
        self._lengths = np.repeat(lengths / 2.0, 2)
        moving = spline.start_ramp.time == 0.0
        starting = moving & (us < nodes[min(optimal.START_INTERVALS, len(lengths))])
        reserve = np.where(starting, 0.0, 1.0)
        share = 1.0 - reserve * optimal.ACCELERATION_RESERVE_SHARE
        sign = np.tile([1.0, -1.0], len(lengths))
        scale = limits.velocity[:, None]
        self._per_acceleration = sign / share * scale / limits.acceleration[:, None]
        share = 1.0 - (0.5 + 0.5 * reserve) * optimal.JERK_RESERVE_SHARE
        self._per_jerk = scale / limits.jerk[:, None] / share

        self._coefficients = spline.coefficients.copy()
        self._place()
        self._sides, self._side_scale, self._centre = side_rows(
            problem, spline, freedom, self._units
        )
        self._root = np.ones_like(us)
        self._update()
        self._root = np.sqrt(self._y[0])
        self._update()
        self._time_scale = 1.0 / float(np.sum(self._lengths / np.sqrt(self._x)))
        self._slack = np.maximum(-self._g, 0.1)
        self._mu = 1.0 / self.size
        self._dual = self._mu / self._slack
        self._gap = np.inf

    def _place(self) -> None:
        """Work out where in the Newton system the unknowns of a sample are."""
        joints, size, free = len(self._velocity), len(self._coefficients), len(self._free)
        index = np.full(len(self._values), free)  # of what is fixed: one more, which is left out
        index[self._free] = np.arange(free)
        used = np.unique(self._free % PARAMETERS)  # where no position is free: without them
        self._used = np.append(used, used + PARAMETERS)
        self._own = index[self._rows.ends[:, self._used]]  # (m, 4 or 6)
        joint = np.arange(joints)[:, None, None]
        own, three = self._own[:, None, :], self._three[:, :, None]
        self._in_cc = (three * size + self._three[:, None, :]).ravel()
        in_cp = (three * (free + 1) + own).reshape(1, len(own), -1)
        self._in_cp = (joint * (size * (free + 1)) + in_cp).ravel()
        in_pp = (self._own[:, :, None] * (free + 1) + own).reshape(1, len(own), -1)
        self._in_pp = (joint * (free + 1) ** 2 + in_pp).ravel()
        self._in_p = (joint * (free + 1) + self._own).ravel()

    @property
    def size(self) -> int:
        """The number of rows."""
        return self._g.size

    @property
    def converged(self) -> bool:
        """Whether there is little more to gain, and the limits are nearly kept."""
        return self._gap < GAP_TOLERANCE and float(self._g.max()) < ROW_TOLERANCE

    @property
    def path(self) -> Path:
        """The path so far."""
        values = self._values.reshape(*self._units.shape, -1)
        position, first, second = np.moveaxis(
            values * self._units[:, :, None] * self._velocity, 1, 0
        )
        free = np.zeros(len(self._values), dtype=bool)
        free[self._free] = True
        kept = ~free.reshape(self._units.shape)[:, :, None]
        knots = self._knots  # what is not free stays to the last bit
        return Path(
            Knots(
                knots.u,
                np.where(kept[:, 0], knots.position, position),
                np.where(kept[:, 1], knots.first, first),
                np.where(kept[:, 2], knots.second, second),
            )
        )

    def _update(self) -> None:
        """Compute the rows."""
        self._y = y = (self._basis @ self._coefficients[self._three][:, :, None])[:, :, 0].T
        self._x = (self._shift * y).sum(axis=0)
        self._q = q = self._rows.derivatives(self._values)
        main = np.empty((_KINDS, *q.shape[1:]))
        main[0] = q[0] ** 2 * self._x - 1.0
        main[1] = self._per_acceleration * (q[0] * (y[1] / 2.0) + q[1] * y[0]) - 1.0
        jerk = q[0] * (y[2] / 2.0) + q[1] * (1.5 * y[1]) + q[2] * y[0]
        jerk *= self._per_jerk * self._root
        right = self._root / np.sqrt(y[0])
        main[2], main[3] = jerk - right, -jerk - right
        sides = self._side_scale * ((self._sides @ self._values).T - self._centre)
        self._g = np.concatenate([main.ravel(), (sides - 1.0).ravel(), (-sides - 1.0).ravel()])

    def _tangents(self) -> Array:
        """Return the rows' derivatives by the unknowns they depend on, shape (4, n, m, 7 or 9)."""
        y, q, root = self._y, self._q, self._root
        weights = self._rows.weights[1:, :, self._used]
        by_y = np.zeros((_KINDS, *q.shape[1:], 3))
        by_y[0] = (q[0] ** 2)[:, :, None] * self._shift.T
        by_y[1, :, :, 0] = self._per_acceleration * q[1]
        by_y[1, :, :, 1] = self._per_acceleration * (q[0] / 2.0)
        scale = self._per_jerk * root
        for k, derivative in enumerate((q[2], 1.5 * q[1], q[0] / 2.0)):
            by_y[2, :, :, k] = scale * derivative
        by_y[3] = -by_y[2]
        by_y[2:, :, :, 0] += 0.5 * root * y[0] ** -1.5
        result = np.empty((_KINDS, *q.shape[1:], 3 + len(self._used)))
        result[..., :3] = (by_y[..., None, :] @ self._basis)[..., 0, :]
        result[0, :, :, 3:] = (2.0 * q[0] * self._x)[:, :, None] * weights[0]
        bend = (y[1] / 2.0)[:, None] * weights[0] + y[0][:, None] * weights[1]
        result[1, :, :, 3:] = self._per_acceleration[:, :, None] * bend
        twist = (y[2] / 2.0)[:, None] * weights[0] + (1.5 * y[1])[:, None] * weights[1]
        twist += y[0][:, None] * weights[2]
        result[2, :, :, 3:] = scale[:, :, None] * twist
        result[3, :, :, 3:] = -result[2, :, :, 3:]
        return result

    def step(self) -> bool:
        """Make a Newton step and return whether that was possible."""
        tangents = self._tangents()
        joints, size, free = len(self._velocity), len(self._coefficients), len(self._free)
        main = tangents[..., 0].size
        stiffness = self._dual / self._slack
        push = self._mu / self._slack + self._dual + stiffness * self._g
        shape = tangents.shape[:3]
        per_row = np.ascontiguousarray(tangents.transpose(1, 2, 0, 3))  # (n, m, 4, 7 or 9)
        weighted = per_row * stiffness[:main].reshape(shape).transpose(1, 2, 0)[..., None]
        blocks = weighted.transpose(0, 1, 3, 2) @ per_row
        forces = (per_row * push[:main].reshape(shape).transpose(1, 2, 0)[..., None]).sum(axis=2)
        # the coefficients' part, with the time
        x_by_c = (self._shift.T[:, None, :] @ self._basis)[:, 0]
        weight = self._time_scale * self._lengths
        bend = (0.75 * weight * self._x**-2.5)[:, None, None]
        cc = blocks[..., :3, :3].sum(axis=0) + bend * x_by_c[:, :, None] * x_by_c[:, None, :]
        c = forces[..., :3].sum(axis=0) - (0.5 * weight * self._x**-1.5)[:, None] * x_by_c
        cc = np.bincount(self._in_cc, cc.ravel(), size * size).reshape(size, size)
        c = np.bincount(self._three.ravel(), c.ravel(), size)
        # each joint's own part, with the rows in the parameters alone
        width = free + 1
        cp = np.bincount(self._in_cp, blocks[..., :3, 3:].ravel(), joints * size * width)
        cp = cp.reshape(joints, size, width)[:, 2:-2, :free]
        pp = np.bincount(self._in_pp, blocks[..., 3:, 3:].ravel(), joints * width * width)
        pp = pp.reshape(joints, width, width)[:, :free, :free]
        p = np.bincount(self._in_p, forces[..., 3:].ravel(), joints * width)
        p = p.reshape(joints, width)[:, :free]
        sides = self._sides[:, self._free] * self._side_scale[:, :, None]  # (n, r, f)
        both = stiffness[main:].reshape(2, *self._side_scale.shape).sum(axis=0)
        one, other = push[main:].reshape(2, *self._side_scale.shape)
        pp = (
            pp
            + _product((sides * both[:, :, None]).transpose(0, 2, 1), sides)
            + DAMPING * np.eye(free)
        )
        p = p + ((one - other)[:, None] @ sides)[:, 0]
        # a joint's parameters depend on the coefficients only, and not on the other joints'
        right = np.concatenate([cp.transpose(0, 2, 1), p[:, :, None]], axis=2)
        try:
            solved = np.linalg.solve(pp, right)
            reduced = _product(cp, solved)
            by = np.zeros(size)
            by[2:-2] = np.linalg.solve(
                cc[2:-2, 2:-2] - reduced[..., :-1].sum(axis=0),
                reduced[..., -1].sum(axis=0) - c[2:-2],
            )
        except np.linalg.LinAlgError:
            return False
        own = np.zeros((joints, width))
        own[:, :free] = -solved[..., -1] - solved[..., :-1] @ by[2:-2]
        unknown = np.empty((joints, len(self._own), tangents.shape[3]))
        unknown[..., :3], unknown[..., 3:] = by[self._three], own[:, self._own]
        change = (per_row @ unknown[..., None])[..., 0].transpose(2, 0, 1).ravel()
        own = own[:, :free]
        sideways = (sides @ own[:, :, None])[:, :, 0].ravel()
        return self._go(by, own.T, np.concatenate([change, sideways, -sideways]))

    def _go(self, by: Array, own: Array, change: Array) -> bool:
        """Go as far along a step as the slacks, the duals and x > 0 allow."""
        if not np.all(np.isfinite(by)) or not np.all(np.isfinite(own)):
            return False
        slack, dual = self._slack, self._dual
        d_slack = -(self._g + slack) - change
        d_dual = (self._mu - slack * dual - dual * d_slack) / slack
        y = (self._basis @ by[self._three][:, :, None])[:, :, 0].T
        slowing = min((y[0] / self._y[0]).min(), ((self._shift * y).sum(axis=0) / self._x).min())
        ahead = min(_longest(slack, d_slack), MAX_CHANGE / max(float(np.abs(own).max()), 1e-12))
        if slowing < 0.0:
            ahead = min(ahead, -0.9 / slowing)
        dual_ahead = _longest(dual, d_dual)
        self._coefficients += ahead * by
        self._values[self._free] += ahead * own
        slack += ahead * d_slack
        dual += dual_ahead * d_dual
        self._update()
        np.maximum(slack, -self._g, out=slack)
        self._gap = float(slack @ dual)
        self._mu = self._gap / self.size * (0.15 if min(ahead, dual_ahead) > 0.7 else 0.5)
        return self._gap < HOPELESS_GAP


def _longest(values: Array, changes: Array) -> float:
    """Return the longest step ≤ 1 that leaves a hundredth of each positive value."""
    fastest = float((changes / values).min())
    return 1.0 if fastest >= 0.0 else min(1.0, -0.99 / fastest)


def _product(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return a @ b, in parts of which BLAS makes no threads in a user's process."""
    columns = max(MAX_PRODUCT // (a.shape[-2] * a.shape[-1]), 1)
    parts = [a @ b[..., begin : begin + columns] for begin in range(0, b.shape[-1], columns)]
    return np.concatenate(parts, axis=-1)
