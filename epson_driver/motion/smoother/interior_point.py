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
from epson_driver.motion.smoother.pentadiagonal import solve_pentadiagonal

MAX_ITERATIONS = 40
RELATIVE_TOLERANCE = 2e-3
"""When to stop: on the rows, and on what more time could be gained, relative."""

ACCEPTED_ROW_EXCESS = 2e-2
"""The same for the rows when the iterations are used up."""

SPEED_COST_EXPONENT = 8
"""p."""

MIN_STEP_SHARE, MAX_SHORT_STEPS = 1e-3, 3
"""So many steps shorter than this lead nowhere."""


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """What to minimise over n coefficients, of which the first and the last two stay.

    basis: (x, x′, x″) from three coefficients, shape (m, 3, 3); first: the first of the three,
    shape (m,). rows: shape (m, r, 3), of which those from `rooted` on have 1/√x at their right.
    weights, wanted: w and c, shape (m,).
    """

    basis: Array
    first: npt.NDArray[np.intp]
    rows: Array
    rooted: int
    weights: Array
    wanted: Array


def minimise(program: Program, start: Array) -> Array | None:
    """Return the coefficients of the minimum that is found from `start`, shape (n,), or None."""
    basis, rows, weights = program.basis, program.rows, program.weights
    size = len(start)
    three = program.first[:, None] + np.arange(3)
    rooted = slice(program.rooted, None)
    free = slice(2, size - 2)

    def values(coefficients: Array) -> Array:
        """Return (x, x′, x″) at the samples, shape (m, 3)."""
        result: Array = (basis @ coefficients[three][:, :, None])[:, :, 0]
        return result

    def excess(y: Array) -> Array:
        """Return how much the rows are beyond their right sides, shape (m, r)."""
        right = np.ones(rows.shape[:2])
        right[:, rooted] = 1.0 / np.sqrt(y[:, :1])
        difference: Array = (rows @ y[:, :, None])[:, :, 0] - right
        return difference

    c = start.copy()
    y = values(c)
    if y[:, 0].min() <= 0.0:
        return None
    scale = 1.0 / float(np.sum(weights / np.sqrt(y[:, 0])))
    g = excess(y)
    slack = np.maximum(-g, 0.1)
    mu = 1.0 / g.size
    dual = mu / slack
    short = 0
    for _ in range(MAX_ITERATIONS):
        tangents = rows.copy()
        tangents[:, rooted, 0] += 0.5 * y[:, :1] ** -1.5
        slope, curvature = _cost(program, y[:, 0])
        primal = g + slack
        hessian = tangents.transpose(0, 2, 1) @ ((dual / slack)[:, :, None] * tangents)
        hessian[:, 0, 0] += scale * curvature
        force = (dual + (mu - slack * dual + dual * primal) / slack)[:, None, :] @ tangents
        force[:, 0, 0] += scale * slope
        solved = solve_pentadiagonal(
            *_bands(basis.transpose(0, 2, 1) @ hessian @ basis, three, size, free),
            -_sum(three, force @ basis, size)[free],
        )
        if solved is None:
            return None
        step = np.zeros(size)
        step[free] = solved
        change = values(step)
        d_slack = -primal - (tangents @ change[:, :, None])[:, :, 0]
        d_dual = (mu - slack * dual - dual * d_slack) / slack
        ahead = min(_longest(slack, d_slack), _longest(y[:, 0], change[:, 0] / 0.9))
        dual_ahead = _longest(dual, d_dual)
        short += ahead < MIN_STEP_SHARE
        if short > MAX_SHORT_STEPS:
            return None
        c += ahead * step
        slack += ahead * d_slack
        dual += dual_ahead * d_dual
        y = values(c)
        g = excess(y)
        slack = np.maximum(slack, -g)
        gap = float(np.sum(slack * dual))
        if gap < RELATIVE_TOLERANCE and g.max() < RELATIVE_TOLERANCE:
            return c
        mu = gap / g.size * (0.15 if min(ahead, dual_ahead) > 0.7 else 0.5)
    return c if g.max() < ACCEPTED_ROW_EXCESS else None


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


def _longest(values: Array, changes: Array) -> float:
    """Return the longest step ≤ 1 that leaves a hundredth of each positive value."""
    falling = changes < 0.0
    if not falling.any():
        return 1.0
    return min(1.0, 0.99 * float(np.min(-values[falling] / changes[falling])))
