# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Banded linear systems, solved in linear time."""

import numpy as np

from epson_driver.motion.limits import Array


def solve_tridiagonal(below: Array, main: Array, above: Array, right: Array) -> Array:
    """Solve below[i] x[i - 1] + main[i] x[i] + above[i] x[i + 1] = right[i] for x.

    All arrays have shape (k, n), for n systems of k equations. below[0] and above[-1] must be 0,
    and the matrices must be diagonally dominant, because the method does not pivot.

    The method is parallel cyclic reduction (Hockney, Jesshope: Parallel Computers, 1981). Each
    round eliminates the neighbours of every row, so that the distance between coupled rows
    doubles. There are log2(k) rounds on whole arrays.
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


def solve_pentadiagonal(main: Array, second: Array, third: Array, right: Array) -> Array | None:
    """Return the solution x of M x = right, or None if M is not positive definite.

    M is symmetric. `main` is its main diagonal, and `second` and `third` are the two diagonals
    above it. All have the shape (n,), so the last element of `second` and the last two of `third`
    are ignored. The method uses plain Python numbers, because a library's dense solver is slower
    for this size and starts threads.
    """
    d, e, f = main.tolist(), second.tolist(), third.tolist()
    y: list[float] = right.tolist()
    count = len(d)
    # M = L D Lᵀ, where l1 and l2 are the diagonals of L below the main diagonal
    d1 = d2 = 1.0
    l1 = l2 = l2_next = y1 = y2 = 0.0
    diagonal, lower1, lower2 = [0.0] * count, [0.0] * count, [0.0] * count
    for i in range(count):
        pivot = d[i] - l1 * l1 * d1 - l2 * l2 * d2
        if not pivot > 0.0:
            return None
        z = y[i] - l1 * y1 - l2 * y2
        next1 = (e[i] - l2_next * l1 * d1) / pivot
        next2 = f[i] / pivot
        diagonal[i], lower1[i], lower2[i] = pivot, next1, next2
        y[i] = z
        l1, l2, l2_next = next1, l2_next, next2
        d1, d2 = pivot, d1
        y1, y2 = z, y1
    x1 = x2 = 0.0
    for i in range(count - 1, -1, -1):
        x = y[i] / diagonal[i]
        if i + 1 < count:
            x -= lower1[i] * x1
        if i + 2 < count:
            x -= lower2[i] * x2
        y[i] = x
        x1, x2 = x, x1
    return np.array(y)


def solve_block_tridiagonal(diagonal: Array, off_diagonal: Array, right: Array) -> Array:
    """Solve a symmetric, positive definite system of b × b blocks. Return x, shape (m, b).

    diagonal: blocks on the diagonal, shape (m, b, b). off_diagonal: blocks to the right of them,
    shape (m - 1, b, b). right: shape (m, b). Raises LinAlgError if a block is singular during the
    elimination.
    """
    size, count = right.shape[1], len(right)
    known: list[Array] = []
    block, force = diagonal[0], right[0]
    for i in range(count - 1):
        known.append(np.linalg.solve(block, np.column_stack([off_diagonal[i], force])))
        less = off_diagonal[i].T @ known[i]
        block, force = diagonal[i + 1] - less[:, :size], right[i + 1] - less[:, size]
    x = np.empty_like(right)
    x[-1] = np.linalg.solve(block, force)
    for i in range(count - 2, -1, -1):
        x[i] = known[i][:, size] - known[i][:, :size] @ x[i + 1]
    return x
