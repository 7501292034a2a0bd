# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Linear systems with few diagonals, solved in time that grows with their size only.

In plain numbers, since for this size a library's dense solver costs more and starts threads.
"""

import numpy as np

from epson_driver.motion.limits import Array


def solve_pentadiagonal(main: Array, second: Array, third: Array, right: Array) -> Array | None:
    """Return x of M x = right for a symmetric, positive definite M; None if M is not.

    The diagonals begin in the first row; shapes (n,), of `second` and `third` the last one and two
    are not used.
    """
    d, e, f = main.tolist(), second.tolist(), third.tolist()
    y: list[float] = right.tolist()
    count = len(d)
    # M = L D Lᵀ: l1, l2 are the diagonals of L below its ones
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
