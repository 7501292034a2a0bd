# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The curves of the last seconds: position, velocity and tracking error of each joint."""

from collections import deque

import numpy as np

from epson_driver.motion import Array

SPAN_S = 20.0
PERIOD_S = 0.1

OVER_S = 0.15
"""A velocity is the difference of positions so far apart, s, or more: measured times tremble by
milliseconds, and near samples would make spikes of that."""

GAP_S = 1.0
"""Positions that are farther apart have no velocity."""

Row = tuple[float, list[float], list[float] | None, list[float] | None]
"""Time by the panel's clock, s; positions, velocities, errors, as they are shown."""


class History:
    """Samples of n joints over the last SPAN_S. `per_unit`: what is shown per rad or m."""

    def __init__(self, per_unit: Array) -> None:
        self._per_unit = per_unit
        self._measured: deque[tuple[float, Array]] = deque()
        self.rows: deque[Row] = deque()

    def add(self, now: float, measured: float, positions: Array, error: Array | None) -> None:
        """Add a sample, with the plan minus it if there is a plan.

        now: by the panel's clock; measured: when by the driver's, s.
        """
        velocities = self._velocities(measured, positions)
        if self.rows and now - self.rows[-1][0] < PERIOD_S:
            return
        self.rows.append(
            (
                round(now, 3),
                self._shown(positions),
                None if velocities is None else self._shown(velocities),
                None if error is None else self._shown(error),
            )
        )
        while now - self.rows[0][0] > SPAN_S:
            self.rows.popleft()

    def _velocities(self, measured: float, positions: Array) -> Array | None:
        samples = self._measured
        if samples and measured <= samples[-1][0]:
            if measured < samples[-1][0]:
                samples.clear()  # another clock
            else:
                samples.pop()
        samples.append((measured, positions))
        while len(samples) > 2 and measured - samples[1][0] >= OVER_S:
            samples.popleft()
        passed = measured - samples[0][0]
        if not 0.0 < passed < GAP_S:
            return None
        return (positions - samples[0][1]) / passed

    def _shown(self, values: Array) -> list[float]:
        found: list[float] = np.round(values * self._per_unit, 4).tolist()
        return found
