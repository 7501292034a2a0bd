# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A primal-dual interior-point method for the one convex problem of `jerk_limited`.

    minimise Σ w / √(F·y)   subject to   G·y ≤ h

Every row of F and G touches three neighbouring unknowns, so the Newton matrix has two diagonals
beside the main one and a step costs as much as there are rows. A general solver for linear
programs takes minutes for the longest plans, this one seconds.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from benchmark.arrays import Index
from epson_driver.motion import Array

MAX_NEWTON_STEPS = 60
"""Newton steps at most; 20 to 30 are usual."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows that touch the unknowns first, first + 1, first + 2: g of them for each of k samples.

    first: shape (k,); weights: (3, g, k). The unknowns are `count`.
    """

    first: Index
    weights: Array
    count: int

    def times(self, y: Array) -> Array:
        """Return the product with a vector (count,), shape (g, k)."""
        w, i = self.weights, self.first
        return np.asarray(w[0] * y[i] + w[1] * y[i + 1] + w[2] * y[i + 2])

    def transposed_times(self, values: Array) -> Array:
        """Return the transposed product with values (g, k), shape (count,)."""
        result = np.zeros(self.count)
        for k, weights in enumerate(self.weights):
            sums = np.einsum('gk,gk->k', weights, values)
            result += np.bincount(self.first + k, sums, self.count)
        return result

    def weighted_square(self, values: Array) -> Array:
        """Return Gᵀ·diag(values)·G as a lower band, shape (3, count)."""
        band = np.zeros((3, self.count))
        for k in range(3):
            weighted = self.weights[k] * values
            for m in range(k + 1):
                sums = np.einsum('gk,gk->k', self.weights[m], weighted)
                band[k - m] += np.bincount(self.first + m, sums, self.count)
        return band


def minimise(
    time: Rows, weights: Array, bounds: Rows, limits: Array, start: Array, gap: float
) -> Array:
    """Return y (count,) that minimises Σ weights/√(time·y) with bounds·y ≤ limits.

    weights and limits have the shapes of their rows, (g, k).

    `start` must fulfil every bound with room to spare. It ends when the duality gap is below
    `gap` times the objective.
    """
    y = start
    slack = limits - bounds.times(y)
    if not slack.min() > 0.0:
        raise ValueError(f'the start breaks a bound by {-slack.min():.3g}')
    objective = float(np.sum(weights / np.sqrt(time.times(y))))
    duals = 0.01 * objective / slack.size / slack
    for _ in range(MAX_NEWTON_STEPS):
        x = time.times(y)
        gradient = time.transposed_times(-0.5 * weights * x**-1.5)
        complementarity = float(np.sum(slack * duals))
        objective = float(np.sum(weights / np.sqrt(x)))
        residual = gradient + bounds.transposed_times(duals)
        if complementarity < gap * objective and np.abs(residual).max() < gap * objective:
            break
        target = 0.1 * complementarity / slack.size
        band = time.weighted_square(0.75 * weights * x**-2.5)
        band += bounds.weighted_square(duals / slack)
        band[0] *= 1.0 + 1e-13
        step = solveh_banded(band, -gradient - bounds.transposed_times(target / slack), lower=True)
        slack_step = -bounds.times(step)
        dual_step = target / slack - duals - duals / slack * slack_step
        primal = min(_reach(slack, slack_step), _reach(x, time.times(step)))
        dual = _reach(duals, dual_step)
        y = y + primal * step
        slack = slack + primal * slack_step
        duals = duals + dual * dual_step
    return y


def _reach(values: Array, steps: Array) -> float:
    """Return how much of a step keeps positive values positive, at most 1."""
    falling = steps < 0.0
    if not falling.any():
        return 1.0
    return min(1.0, 0.97 * float(np.min(-values[falling] / steps[falling])))
