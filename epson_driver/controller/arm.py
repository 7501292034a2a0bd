# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated arm: where it is, and the move that it is on."""

import numpy as np

from epson_driver.controller.points import clipped
from epson_driver.motion import Array, JointLimits, go


class Arm:
    """An arm that moves from rest to rest along lines in joint space, inside its limits.

    `position` has shape (n,), rad. Time is passed in with `step`. Raises ValueError for a start
    that is not n finite angles within the limits.
    """

    def __init__(self, limits: JointLimits, start: Array) -> None:
        self.limits = limits
        self._motion = go(limits, start, start)
        self._time = 0.0
        self._stopping = False

    @property
    def moving(self) -> bool:
        """Whether a move has not ended yet."""
        return self._time < self._motion.duration

    @property
    def position(self) -> Array:
        """The commanded joint angles now, shape (n,), rad."""
        position, _, _ = self._motion.at(self._time)
        # The last digit of a position on a line that ends at a limit may lie beyond it.
        return clipped(position, self.limits)

    def stands_at(self, target: Array) -> bool:
        """Return whether the arm rests at `target` as far as messages (float32) can tell."""
        same = np.array_equal(self.position.astype(np.float32), target.astype(np.float32))
        return same and not self.moving

    def start(self, target: Array, speed: float, accel: float) -> None:
        """Begin a move from rest to `target`.

        `speed` and `accel` are fractions (0, 1] of the limits. Raises as `motion.go` does, and
        RuntimeError while the arm moves.
        """
        if self.moving:
            raise RuntimeError('a move can only begin at rest')
        self._motion = go(self.limits, self.position, target, speed, accel)
        self._time = 0.0
        self._stopping = False

    def stop(self) -> None:
        """Begin to brake along the line, as fast as the limits allow."""
        if self.moving and not self._stopping:
            self._motion = self._motion.stop(self._time)
            self._time = 0.0
            self._stopping = True

    def step(self, dt: float) -> float | None:
        """Let `dt` ≥ 0 s pass.

        Return how much of it was left when the arm came to rest, s; None while it still moves.
        """
        self._time += dt
        if self.moving:
            return None
        return min(self._time - self._motion.duration, dt)
