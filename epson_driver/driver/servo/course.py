# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Where a setpoint leads in the moments after it came."""

from bisect import bisect_right

import numpy as np

from epson_driver.driver.servo.setpoint import Setpoint
from epson_driver.motion import Array, JointLimits

MAX_EXTRAPOLATION_S = 0.04
"""So long after its last point a setpoint goes on with the velocity there, s: until the next one
comes, in streams of 30 Hz and more."""


class Course:
    """Positions and velocities over time, from one setpoint of positions.

    They are made from all points of a window, within the range and the velocity limits. Times are
    since the setpoint came, s. `estimate`: velocities for a setpoint that has none, shape (n,).
    """

    def __init__(
        self, setpoint: Setpoint, limits: JointLimits, estimate: Array | None = None
    ) -> None:
        assert setpoint.positions is not None  # noqa: S101 - who asks knows the mode
        window = setpoint.window
        if window is None:
            times, positions = np.zeros(1), setpoint.positions[None]
            given = setpoint.velocities if setpoint.velocities is not None else estimate
            velocities = np.zeros_like(positions) if given is None else given[None]
        else:
            times, positions = window.times, window.positions
            velocities = (
                np.gradient(positions, times, axis=0)
                if window.velocities is None
                else window.velocities
            )
        self._times: list[float] = times.tolist()
        self._positions = np.clip(positions, limits.position_min, limits.position_max)
        self._velocities = np.clip(velocities, -limits.velocity, limits.velocity)

    @property
    def reach(self) -> float:
        """How far ahead of its arrival it is known, s; 0 for a single setpoint."""
        return max(self._times[-1], 0.0)

    def at(self, time: float) -> tuple[Array, Array]:
        """Return position and velocity at a time, shapes (n,).

        Between points they are those of a cubic; before the first one nothing moves yet, after
        the last one its velocity goes on for MAX_EXTRAPOLATION_S.
        """
        times, positions, velocities = self._times, self._positions, self._velocities
        if time >= times[-1]:
            on = min(time - times[-1], MAX_EXTRAPOLATION_S)
            return positions[-1] + on * velocities[-1], velocities[-1]
        index = bisect_right(times, time) - 1
        if index < 0:
            return positions[0], velocities[0]
        span = times[index + 1] - times[index]
        s = (time - times[index]) / span
        before, after = positions[index], positions[index + 1]
        leaving, arriving = velocities[index] * span, velocities[index + 1] * span
        # Hermite's cubic, as before + s·leaving + s²·b + s³·a
        a = 2.0 * (before - after) + leaving + arriving
        b = 3.0 * (after - before) - 2.0 * leaving - arriving
        position = before + s * (leaving + s * (b + s * a))
        velocity = (leaving + s * (2.0 * b + s * 3.0 * a)) / span
        return position, velocity
