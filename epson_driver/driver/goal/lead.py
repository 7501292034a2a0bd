# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How far ahead of its clock a goal is sent that may be left on its way."""

from collections import deque

import numpy as np

from epson_driver.driver.delivery.trajectory_points import with_velocities
from epson_driver.motion import Array, JointLimits, Trajectory

MAX_LATENCY_S = 0.2
"""The latency until it was measured, and at most, s."""

MIN_LATENCY_S = 0.13
"""The least, s: an arm that is slow soon stops, and any plan may take 0.1 s for once."""

PERCENTILE, MARGIN_FACTOR = 0.9, 1.3
"""The latency is so much of how far the arm was behind, times this."""

MIN_SAMPLES, MAX_SAMPLES = 40, 400
"""How often that is measured before it counts, and how many of the last ones do. Joints come every
5 ms as a rule."""

MIN_SPEED_SHARE = 0.05
"""A slower plan, as a share of each velocity limit, does not show how far the arm is behind."""


class Lead:
    """So far ahead that the arm keeps its speed: a latency, and a stop from the plan's speed.

    How far the arm is behind the plan's clock is measured. Planning in the controller, messages
    and servos are all in it, and a controller that knows too little, or plans slowly, gets
    farther behind, so that it is sent more.
    """

    def __init__(self, limits: JointLimits) -> None:
        self._limits = limits
        self._behind: deque[float] = deque(maxlen=MAX_SAMPLES)

    @property
    def most(self) -> float:
        """The most that it can be, s."""
        return MAX_LATENCY_S + float(np.max(self._stop(self._limits.velocity)))

    @property
    def latency(self) -> float:
        """What a controller should know beyond a stop, s."""
        count = len(self._behind)
        if count < MIN_SAMPLES:
            return MAX_LATENCY_S
        measured = MARGIN_FACTOR * sorted(self._behind)[int(PERCENTILE * count)]
        return min(max(measured, MIN_LATENCY_S), MAX_LATENCY_S)

    def see(self, offset: Array, velocity: Array) -> None:
        """Measure how far the arm is behind: by an offset, shape (n,), rad, at a speed, rad/s."""
        shares = velocity / self._limits.velocity
        if np.max(np.abs(shares)) >= MIN_SPEED_SHARE:
            offsets = offset / self._limits.velocity
            self._behind.append(float(offsets @ shares / (shares @ shares)))

    def stops(self, trajectory: Trajectory) -> list[float]:
        """Return the time of a stop from the highest speed before each point but the first, s."""
        known = with_velocities(trajectory)
        assert known.velocities is not None  # noqa: S101 - for the type checker
        speeds = np.abs(known.velocities)
        means = np.abs(np.diff(known.positions, axis=0)) / np.diff(known.times)[:, None]
        highest = np.maximum(np.maximum(speeds[:-1], speeds[1:]), means)
        stops: list[float] = np.max(self._stop(highest), axis=1).tolist()
        return stops

    def _stop(self, speed: Array) -> Array:
        """Return how long the joints take to stop, s, from speeds, shape (…, n), rad/s."""
        acceleration, jerk = self._limits.acceleration, self._limits.jerk
        # the acceleration is reached, or the jerk changes sign before
        return np.where(
            speed * jerk >= acceleration**2,
            speed / acceleration + acceleration / jerk,
            2.0 * np.sqrt(speed / jerk),
        )
