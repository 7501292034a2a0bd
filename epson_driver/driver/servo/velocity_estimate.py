# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How fast a stream of positions moves, if it does not say so itself."""

from collections import deque

import numpy as np

from epson_driver.motion import Array

MEMORY_S = 0.1
"""Older positions do not count, s."""

MIN_SPAN_S = 0.02
"""Positions that came closer together say nothing of the velocity, s: they were held up."""


class VelocityEstimate:
    """Estimates velocities from positions and the times at which they came, s.

    Of the slope over MEMORY_S and that over the last step, the smaller one counts for each joint,
    and none if they differ in sign. So it is low at once when a stream comes to a hold, and the
    time that a message took hardly matters.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[float, Array]] = deque()

    def add(self, time: float, position: Array) -> Array:
        """Take a position, shape (n,), and return the velocities, shape (n,)."""
        seen = self._seen
        if seen and time - seen[-1][0] > MEMORY_S:
            seen.clear()
        seen.append((time, position))
        while time - seen[0][0] > MEMORY_S:
            seen.popleft()
        recent = next((each for each in reversed(seen) if time - each[0] >= MIN_SPAN_S), None)
        if recent is None:
            return np.zeros_like(position)
        long = (position - seen[0][1]) / (time - seen[0][0])
        short = (position - recent[1]) / (time - recent[0])
        least = np.minimum(np.abs(long), np.abs(short))
        velocities: Array = np.where(long * short > 0.0, np.sign(long) * least, 0.0)
        return velocities
