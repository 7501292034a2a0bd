# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Linear systems with three diagonals, as cubic splines have them, by parallel cyclic reduction.

Each round eliminates the neighbours of every row at once, so that the rows that are left coupled
are twice as far apart: log2(k) rounds on whole arrays, and memory for a few of them (Hockney,
Jesshope: Parallel Computers, 1981). No pivoting: the matrix must be diagonally dominant.
"""

import numpy as np

from epson_driver.motion.limits import Array


def solve_tridiagonal(below: Array, main: Array, above: Array, right: Array) -> Array:
    """Return x of below[i] x[i - 1] + main[i] x[i] + above[i] x[i + 1] = right[i], shape (k, n).

    All of shape (k, n): n systems. below[0] and above[-1] are 0.
    """
    lower, upper = below / main, above / main
    x: Array = right / main
    distance = 1
    while distance < len(x):
        before, after = slice(None, -distance), slice(distance, None)
        pivot = np.ones_like(lower)
        pivot[after] -= lower[after] * upper[before]
        pivot[before] -= upper[before] * lower[after]
        new_x, new_lower, new_upper = x.copy(), np.zeros_like(lower), np.zeros_like(upper)
        new_x[after] -= lower[after] * x[before]
        new_x[before] -= upper[before] * x[after]
        new_lower[after] = -lower[after] * lower[before]
        new_upper[before] = -upper[before] * upper[after]
        x, lower, upper = new_x / pivot, new_lower / pivot, new_upper / pivot
        distance *= 2
    return x
