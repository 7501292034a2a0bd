# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Point-to-point motion: the arm rests at every point."""

import numpy as np

from epson_driver.controller.executor import Point
from epson_driver.controller.points import clipped
from epson_driver.motion import Array, JointLimits, go


class PointToPoint:
    """An arm that moves from rest to rest along lines in joint space, inside its limits.

    `start` has shape (n,), rad. `speed` and `accel` are fractions (0, 1] of the limits; a point's
    own velocity can only make its move slower. Raises ValueError for a start that is not n finite
    angles within the limits.
    """

    def __init__(
        self, limits: JointLimits, start: Array, speed: float = 1.0, accel: float = 1.0
    ) -> None:
        self.limits = limits
        self._speed = speed
        self._accel = accel
        self._motion = go(limits, start, start)
        self._time = 0.0
        self._stopping = False

    @property
    def moving(self) -> bool:
        """Whether a move has not ended yet."""
        return self._time < self._motion.duration

    @property
    def has_room(self) -> bool:
        """Whether the arm rests."""
        return not self.moving

    @property
    def done(self) -> bool:
        """Whether the arm rests."""
        return not self.moving

    @property
    def position(self) -> Array:
        """The commanded joint angles now, shape (n,), rad."""
        position, _, _ = self._motion.at(self._time)
        # The last digit of a position on a line that ends at a limit may lie beyond it.
        return clipped(position, self.limits)

    def take(self, point: Point) -> None:
        """Begin a move from rest to a point; none if the arm is there.

        Raises as `motion.go` does, and RuntimeError while the arm moves.
        """
        if self.moving:
            raise RuntimeError('a move can only begin at rest')
        if self._stands_at(point.target):
            return
        speed = min(self._speed, point.velocity or 1.0)
        self._motion = go(self.limits, self.position, point.target, speed, self._accel)
        self._time = 0.0
        self._stopping = False

    def stop(self) -> bool:
        """Brake along the line, as fast as the limits allow; no answered point is lost."""
        if self.moving and not self._stopping:
            self._motion = self._motion.stop(self._time)
            self._time = 0.0
            self._stopping = True
        return False

    def step(self, dt: float) -> float | None:
        """Let `dt` ≥ 0 s pass.

        Return how much of it was left when the arm came to rest, s; None while it still moves.
        """
        self._time += dt
        if self.moving:
            return None
        return min(self._time - self._motion.duration, dt)

    def _stands_at(self, target: Array) -> bool:
        """Return whether the arm rests at `target` as far as messages (float32) can tell."""
        return np.array_equal(self.position.astype(np.float32), target.astype(np.float32))
