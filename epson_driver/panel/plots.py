# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The curves of the last seconds: position, velocity and tracking error of each joint."""

from collections import deque

import numpy as np

from epson_driver.motion import Array

SPAN_S = 20.0
PERIOD_S = 0.1

COLOURS = (
    '#1971c2', '#e8590c', '#2f9e44', '#9c36b5', '#e03131', '#0c8599', '#f08c00', '#495057',
)  # fmt: skip
"""Of the joints, from the first on."""


class History:
    """Samples of n joints over the last SPAN_S. `per_unit`: what is shown per rad or m."""

    def __init__(self, per_unit: Array) -> None:
        self._per_unit = per_unit
        self._rows: deque[tuple[float, Array, Array, Array]] = deque()

    def add(self, now: float, positions: Array, velocities: Array, error: Array | None) -> None:
        """Add a sample, perhaps without an error, at `now` of the panel's clock, s."""
        missing = np.zeros(len(positions)) if error is None else error
        self._rows.append((now, positions, velocities, missing))
        while now - self._rows[0][0] > SPAN_S:
            self._rows.popleft()

    def curves(self, now: float) -> tuple[tuple[Array, ...], ...]:
        """Return for each of the three quantities the times, s before now, and the joints."""
        if not self._rows:
            empty = np.zeros(0)
            return ((empty,) * (len(self._per_unit) + 1),) * 3
        times = np.array([row[0] for row in self._rows]) - now
        found = []
        for quantity in (1, 2, 3):
            values = np.array([row[quantity] for row in self._rows]) * self._per_unit
            found.append((times, *np.ascontiguousarray(values.T)))
        return tuple(found)
