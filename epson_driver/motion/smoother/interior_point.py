# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An interior-point method for the fastest timing along a path.

u is the path parameter, and x(u) = u̇² the square of the speed. The method minimises the sum of

    w (1/√x + (x/c²)^p / (2 p c))

over m samples with the weights w. The first term is the time, the second one the cost of exceeding
the target speed c. Each sample has its minimum at x = c². Its constraints, called rows, are

    row · (x, x′, x″) ≤ 1, or ≤ 1/√x for some rows

1/√x is convex and therefore above its tangent, which replaces it in each step, so each step leads
towards an allowed point. At a sample, x and its derivatives depend on three neighbouring
coefficients of a spline. Therefore a Newton step solves a system with five diagonals. Primal and
dual variables have separate step lengths
(Nocedal & Wright, Numerical Optimization, chapter 19).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array
from epson_driver.motion.smoother.banded import solve_pentadiagonal
from epson_driver.motion.smoother.request import NEWTON_STEP_US, ROW_US, Effort

MAX_ITERATIONS = 40
RELATIVE_TOLERANCE = 2e-3
"""Tolerance of a solution: excess of a row over 1, and by default the part of the time that could
still be saved."""

ACCEPTED_ROW_EXCESS = 2e-2
"""Excess of a row over 1 that is accepted after the last iteration."""

SPEED_COST_EXPONENT = 8
"""Exponent p of the cost of a high speed."""

MIN_STEP_SHARE, MAX_SHORT_STEPS = 5e-3, 2
"""The search ends after more than MAX_SHORT_STEPS steps below MIN_STEP_SHARE of a Newton step."""

MIN_ITERATIONS, SLOWEST_RATE = 12, 0.88
"""After MIN_ITERATIONS, the search ends if the factor by which the rows' excess has decreased per
iteration is above SLOWEST_RATE on average."""

_UPPER = np.triu_indices(3)


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """Cost and constraints of n spline coefficients. The first two and the last two are fixed.

    * basis: matrix from three coefficients to (x, x′, x″) at each sample, shape (m, 3, 3).
    * first: index of the first of these three coefficients, shape (m,).
    * rows: constraints at each sample, shape (m, r, 3).
    * rooted: index of the first row whose right side is 1/√x.
    * back: how far before each sample, in u, the cost is evaluated, shape (m,).
    * weights, target_speeds: w and c of the cost, shape (m,).
    """

    basis: Array
    first: npt.NDArray[np.intp]
    rows: Array
    rooted: int
    back: Array
    weights: Array
    target_speeds: Array


def minimise(
    program: Program, start: Array, effort: Effort, tolerance: float = RELATIVE_TOLERANCE
) -> Array | None:
    """Return the coefficients of the minimum, shape (n,), or None if none was found.

    tolerance: fraction of the time that could still be saved when the search ends.
    """
    # the samples are the last axis, because sums over rows are then faster
    rows = np.ascontiguousarray(program.rows.transpose(2, 1, 0))  # (3, r, m)
    basis = np.ascontiguousarray(program.basis.transpose(1, 2, 0))  # (3, 3, m)
    three = program.first + np.arange(3)[:, None]  # (3, m)
    size = len(start)
    free = slice(2, size - 2)
    rooted = program.rooted
    # diagonal and first row of each part of a symmetric block, with the right side last
    diagonal = np.append(_UPPER[1] - _UPPER[0], [3, 3, 3])[:, None]
    place = (diagonal * size + three[np.append(_UPPER[0], range(3))]).ravel()

    def values(coefficients: Array) -> Array:
        result: Array = np.einsum('kjm,jm->km', basis, coefficients[three])
        return result

    # work arrays reused in each iteration, because arrays of this size are slow to allocate
    shape = rows.shape[1:]
    tangents, weighted = rows.copy(), np.empty((4, *shape))
    stiffness, d_slack, d_dual, g, spare = (np.empty(shape) for _ in range(5))

    def update_excess() -> None:
        np.einsum('krm,km->rm', rows, y, out=g)
        g[:rooted] -= 1.0
        g[rooted:] -= root / np.sqrt(y[0])

    def longest(values: Array, changes: Array) -> float:
        """Return the longest step ≤ 1 that reduces no positive value by more than 99 %.

        A step adds this multiple of `changes` to `values`.
        """
        fastest = float(np.divide(changes, values, out=spare).min())
        return 1.0 if fastest >= 0.0 else min(1.0, -0.99 / fastest)

    c = start.copy()
    y = values(c)
    shift = np.stack([np.ones_like(program.back), -program.back, program.back**2 / 2.0])
    outer = shift[:, None] * shift  # (3, 3, m)
    cost = _cost(program)

    def counted(y: Array) -> Array:
        result: Array = np.einsum('km,km->m', shift, y)
        return result

    x = counted(y)
    if min(x.min(), y[0].min()) <= 0.0:
        return None
    # scaled so that the right sides are about 1 at any speed
    root = np.sqrt(y[0])
    rows[:, rooted:] *= root
    tangents[:, rooted:] *= root
    scale = 1.0 / float(np.sum(program.weights / np.sqrt(x)))
    update_excess()
    slack = np.maximum(-g, 0.1)
    mu = 1.0 / g.size
    dual = mu / slack
    missing = 1.0
    short = 0
    for iteration in range(MAX_ITERATIONS):
        if effort.used_up:
            break
        effort.spend(NEWTON_STEP_US + ROW_US * g.size)
        np.add(rows[0, rooted:], 0.5 * root * y[0] ** -1.5, out=tangents[0, rooted:])
        slope, curvature = cost(x)
        np.divide(dual, slack, out=stiffness)
        np.multiply(stiffness, tangents, out=weighted[:3])
        # dual + (mu - slack · dual + dual · (g + slack)) / slack
        push = np.divide(mu, slack, out=weighted[3])
        push += dual
        push += np.multiply(stiffness, g, out=spare)
        sums = np.einsum('arm,brm->abm', weighted, tangents)
        hessian = sums[:3] + scale * curvature * outer
        force = sums[3] + scale * slope * shift
        blocks = np.einsum('kim,kjm->ijm', basis, np.einsum('klm,ljm->kjm', hessian, basis))
        right = np.einsum('km,kjm->jm', -force, basis)
        parts = np.concatenate([blocks[_UPPER], right]).ravel()
        solved = solve_pentadiagonal(*np.bincount(place, parts, 4 * size).reshape(4, -1)[:, free])
        if solved is None:
            return None
        step = np.zeros(size)
        step[free] = solved
        change = values(step)
        # -(g + slack) - tangents · change
        np.einsum('krm,km->rm', tangents, change, out=d_slack)
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
        if min(x.min(), y[0].min()) <= 0.0:
            return None  # caused by rounding if x is almost 0
        update_excess()
        np.maximum(slack, np.negative(g, out=spare), out=slack)
        gap = float(np.multiply(slack, dual, out=spare).sum())
        if gap < tolerance and g.max() < RELATIVE_TOLERANCE:
            return c
        mu = gap / g.size * (0.15 if min(ahead, dual_ahead) > 0.7 else 0.5)
    return c if g.max() < ACCEPTED_ROW_EXCESS else None


def _cost(program: Program) -> Callable[[Array], tuple[Array, Array]]:
    """Return a function from x to the first and second derivative of the cost, shapes (m,)."""
    target_speeds, weights, p = program.target_speeds, program.weights, SPEED_COST_EXPONENT
    of_time = 0.5 * weights
    of_speed, of_speeding = of_time / target_speeds**3, (p - 1) * of_time / target_speeds**5

    def cost(x: Array) -> tuple[Array, Array]:
        over = np.minimum(x / target_speeds**2, 1e3)
        power, time = over ** (p - 2), of_time * x**-1.5
        return of_speed * power * over - time, 1.5 * time / x + of_speeding * power

    return cost
