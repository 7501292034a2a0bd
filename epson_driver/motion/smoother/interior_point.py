# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An interior-point method for the fastest timing along a path.

Minimised is the sum over m samples of w (1/√x + (x/c²)^p / (2 p c)): the time, and the cost of
being faster than the speed c that is wanted (its minimum is at x = c²). Subject to
    rows · (x, x′, x″) ≤ 1, for some rows ≤ 1/√x instead.
1/√x is convex: its tangent lies below, so each step is towards a point that is allowed.
(x, x′, x″) at a sample depend on three neighbouring coefficients, which leaves a system of five
diagonals for a Newton step. Primal and dual variables go their own step lengths (Nocedal & Wright,
Numerical Optimization, chapter 19).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array
from epson_driver.motion.smoother.effort import NEWTON_STEP_US, ROW_US, Effort
from epson_driver.motion.smoother.pentadiagonal import solve_pentadiagonal

MAX_ITERATIONS = 40
RELATIVE_TOLERANCE = 2e-3
"""When to stop: on the rows, and, by default, on what more time could be gained, relative."""

ACCEPTED_ROW_EXCESS = 2e-2
"""The same for the rows when the iterations are used up."""

SPEED_COST_EXPONENT = 8
"""p."""

MIN_STEP_SHARE, MAX_SHORT_STEPS = 5e-3, 2
"""So many steps shorter than this lead nowhere."""

MIN_ITERATIONS, SLOWEST_RATE = 12, 0.88
"""After so many iterations the rows must be as if each had left this share of their excess."""


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """What to minimise over n coefficients, of which the first and the last two stay.

    basis: (x, x′, x″) from three coefficients, shape (m, 3, 3); first: the first of the three,
    shape (m,). rows: shape (m, r, 3), of which those from `rooted` on have 1/√x at their right.
    back: how far before a sample it is that x counts for the cost, in u; weights, wanted: w and c
    there; shape (m,).
    """

    basis: Array
    first: npt.NDArray[np.intp]
    rows: Array
    rooted: int
    back: Array
    weights: Array
    wanted: Array


def minimise(
    program: Program, start: Array, effort: Effort, tolerance: float = RELATIVE_TOLERANCE
) -> Array | None:
    """Return the coefficients of the minimum that is found from `start`, shape (n,), or None.

    tolerance: when to stop, of what more time could be gained, relative.
    """
    basis, weights = program.basis, program.weights
    # the samples last: each row, and each part of the sums over the rows, is one array
    rows = np.ascontiguousarray(program.rows.transpose(2, 1, 0))  # (3, r, m)
    size = len(start)
    three = program.first[:, None] + np.arange(3)
    free = slice(2, size - 2)
    rooted = program.rooted

    def values(coefficients: Array) -> Array:
        """Return (x, x′, x″) at the samples, shape (3, m)."""
        result: Array = (basis @ coefficients[three][:, :, None])[:, :, 0].T
        return np.ascontiguousarray(result)

    # what is written anew in each iteration: arrays of this size are slow to allocate
    shape = rows.shape[1:]
    bent = rows[0].copy()
    stiffness, push, d_slack, d_dual, g, spare = (np.empty(shape) for _ in range(6))

    def along(first: Array, y: Array, result: Array) -> None:
        """Put (first, rows[1], rows[2]) · (x, x′, x″) into the result, shape (r, m)."""
        np.multiply(first, y[0], out=result)
        for k in (1, 2):
            np.multiply(rows[k], y[k], out=spare)
            result += spare

    def update_excess() -> None:
        """Put into g how much the rows are beyond their right sides."""
        along(rows[0], y, g)
        g[:rooted] -= 1.0
        g[rooted:] -= root / np.sqrt(y[0])

    def longest(values: Array, changes: Array) -> float:
        """Return the longest step ≤ 1 that leaves a hundredth of each positive value."""
        fastest = float(np.divide(changes, values, out=spare).min())
        return 1.0 if fastest >= 0.0 else min(1.0, -0.99 / fastest)

    c = start.copy()
    y = values(c)
    shift = np.stack([np.ones_like(program.back), -program.back, program.back**2 / 2.0])

    def counted(y: Array) -> Array:
        """Return x where it counts for the cost, shape (m,)."""
        result: Array = (shift * y).sum(axis=0)
        return result

    x = counted(y)
    if min(x.min(), y[0].min()) <= 0.0:
        return None
    # so that the right sides are about 1, however slow it is
    root = np.sqrt(y[0])
    rows[:, rooted:] *= root
    bent[rooted:] *= root
    scale = 1.0 / float(np.sum(weights / np.sqrt(x)))
    outer = (shift[:, None] * shift).transpose(2, 0, 1)
    update_excess()
    slack = np.maximum(-g, 0.1)
    mu = 1.0 / g.size
    dual = mu / slack
    missing = 1.0
    short = 0
    hessian = np.empty((len(weights), 3, 3))
    force = np.empty((len(weights), 3))
    for iteration in range(MAX_ITERATIONS):
        if effort.used_up:
            break
        effort.spend(NEWTON_STEP_US + ROW_US * g.size)
        np.add(rows[0, rooted:], 0.5 * root * y[0] ** -1.5, out=bent[rooted:])
        tangents = (bent, rows[1], rows[2])
        slope, curvature = _cost(program, x)
        np.divide(dual, slack, out=stiffness)
        # dual + (mu - slack · dual + dual · (g + slack)) / slack
        np.divide(mu, slack, out=push)
        push += dual
        push += np.multiply(stiffness, g, out=spare)
        for i in range(3):
            np.multiply(stiffness, tangents[i], out=spare)
            for j in range(i, 3):
                hessian[:, i, j] = hessian[:, j, i] = _row_sums(spare, tangents[j])
            force[:, i] = _row_sums(push, tangents[i])
        hessian += (scale * curvature)[:, None, None] * outer
        force += (scale * slope * shift).T
        solved = solve_pentadiagonal(
            *_bands(basis.transpose(0, 2, 1) @ hessian @ basis, three, size, free),
            -_sum(three, (force[:, None, :] @ basis)[:, 0], size)[free],
        )
        if solved is None:
            return None
        step = np.zeros(size)
        step[free] = solved
        change = values(step)
        # -(g + slack) - tangents · change
        along(bent, change, d_slack)
        d_slack += g
        d_slack += slack
        np.negative(d_slack, out=d_slack)
        # (mu - slack · dual - dual · d_slack) / slack
        np.divide(mu, slack, out=d_dual)
        d_dual -= dual
        d_dual -= np.multiply(stiffness, d_slack, out=spare)
        ahead = longest(slack, d_slack)
        slowing = float(min((change[0] / y[0]).min(), (counted(change) / x).min()))
        if slowing < 0.0:
            ahead = min(ahead, -0.9 / slowing)
        dual_ahead = longest(dual, d_dual)
        short += ahead < MIN_STEP_SHARE
        missing *= 1.0 - ahead
        hopeless = iteration >= MIN_ITERATIONS and missing > SLOWEST_RATE**iteration
        if short > MAX_SHORT_STEPS or hopeless:
            break
        c += ahead * step
        slack += np.multiply(d_slack, ahead, out=spare)
        dual += np.multiply(d_dual, dual_ahead, out=spare)
        y = values(c)
        x = counted(y)
        update_excess()
        np.maximum(slack, np.negative(g, out=spare), out=slack)
        gap = float(np.multiply(slack, dual, out=spare).sum())
        if gap < tolerance and g.max() < RELATIVE_TOLERANCE:
            return c
        mu = gap / g.size * (0.15 if min(ahead, dual_ahead) > 0.7 else 0.5)
    return c if g.max() < ACCEPTED_ROW_EXCESS else None


def _row_sums(one: Array, other: Array) -> Array:
    """Return the sums over the rows of products, shapes (r, m) to (m,)."""
    sums: Array = np.einsum('rm,rm->m', one, other)
    return sums


def _cost(program: Program, x: Array) -> tuple[Array, Array]:
    """Return first and second derivative by x of what is minimised, shapes (m,)."""
    wanted, p = program.wanted, SPEED_COST_EXPONENT
    over = np.minimum(x / wanted**2, 1e3)
    slope = 0.5 * (over ** (p - 1) / wanted**3 - x**-1.5)
    curvature = 0.75 * x**-2.5 + 0.5 * (p - 1) * over ** (p - 2) / wanted**5
    return program.weights * slope, program.weights * curvature


def _bands(
    blocks: Array, three: npt.NDArray[np.intp], size: int, free: slice
) -> tuple[Array, Array, Array]:
    """Return the diagonals of the sum of blocks, shape (m, 3, 3), on the coefficients `three`."""
    main, second, third = (
        _sum(three[:, : 3 - k], blocks[:, np.arange(3 - k), np.arange(k, 3)], size)[free]
        for k in range(3)
    )
    return main, second, third


def _sum(where: npt.NDArray[np.intp], values: Array, size: int) -> Array:
    """Return the sums of the values that belong to each of `size` places."""
    sums: Array = np.bincount(where.ravel(), values.ravel(), size).astype(float)
    return sums
