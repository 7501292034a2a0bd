# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How fast trajectories run, as a share of the planned speed: 0 … 1, and ramped between."""

import math
from dataclasses import replace
from typing import TypeVar

from epson_driver.driver.delivery.trajectory_points import MIN_VELOCITY
from epson_driver.simple_message import JointTrajPt, JointTrajPtFull, Message

RAMP_PER_S = 2.0
"""How fast the factor changes, 1/s: half a second from a pause to full speed."""

MIN_FACTOR = 0.01
"""The smallest factor but 0. Below it, points would take longer than anybody waits."""

M = TypeVar('M', bound=Message)


class SpeedScaling:
    """A factor that goes to its target in a ramp. Times (`now`) are monotonic, s."""

    def __init__(self) -> None:
        self._from = 1.0
        self._target = 1.0
        self._since = 0.0

    @property
    def target(self) -> float:
        """The factor that was asked for."""
        return self._target

    def set(self, factor: float, now: float) -> None:
        """Go to another factor from now on. Raises ValueError with what is allowed."""
        if not (factor == 0.0 or MIN_FACTOR <= factor <= 1.0):
            raise ValueError(
                f'the factor {factor:g} must be 0 (pause) or from {MIN_FACTOR:g} to 1 (as planned)'
            )
        self._from, self._target, self._since = self.factor(now), factor, now

    def factor(self, now: float) -> float:
        """Return the factor at a moment after the last `set`."""
        way = self._target - self._from
        if not way:
            return self._target
        done = max(now - self._since, 0.0) * RAMP_PER_S
        if done >= abs(way):
            return self._target
        return self._from + (done if way > 0.0 else -done)

    def time_for(self, planned: float, now: float) -> float | None:
        """Return how long `planned` seconds of a plan that begin now take, s; None: they stop.

        The ramp counts: a motion that begins in a pause that ends is not slow for long, and one
        that begins while the factor goes to 0 may come to its end or not.
        """
        factor = self.factor(now)
        if factor == self._target:
            return planned / factor if factor else None
        ramp = abs(self._target - factor) / RAMP_PER_S
        in_ramp = (factor + self._target) / 2 * ramp
        if planned > in_ramp:
            left = planned - in_ramp
            return ramp + left / self._target if self._target else None
        slope = RAMP_PER_S if self._target > factor else -RAMP_PER_S
        # planned = factor · t + slope · t² / 2, the form that is exact for small t
        root = math.sqrt(max(factor * factor + 2 * slope * planned, 0.0))
        return 2 * planned / (factor + root)


def scaled(message: M, factor: float, delay: float) -> M:
    """Return a point's message at `factor` (0, 1] of its planned speed.

    `delay` is how much later than planned the point is then to be reached, s: some messages count
    their time from the start of the trajectory.
    """
    if factor == 1.0 and delay == 0.0:
        return message
    if isinstance(message, JointTrajPt):
        return replace(
            message,
            velocity=min(max(message.velocity * factor, MIN_VELOCITY), message.velocity),
            duration=message.duration / factor,
        )
    if isinstance(message, JointTrajPtFull):
        return replace(
            message,
            time=message.time + delay,
            velocities=tuple(value * factor for value in message.velocities),
            accelerations=tuple(value * factor**2 for value in message.accelerations),
        )
    return message
