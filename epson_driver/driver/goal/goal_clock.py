# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Where a goal should be now: its plan, and a clock that knows pauses and the speed scaling.

Rules:
1. The clock runs from when the first point is sent, whatever the controller makes of the points:
   one that rests at each point falls behind it.
2. In a segment whose end was sent, it runs at the factor with which that point was sent: what the
   controller has acknowledged is not changed by a later factor. Beyond, it runs at the factor of
   the moment; while points are held back, it stops.
3. While the controller is paused, and once the goal is being stopped, it stands.
"""

from array import array

import numpy as np

from epson_driver.driver.goal.speed_scaling import SpeedScaling
from epson_driver.motion import Array, Trajectory


class Reference:
    """A trajectory as a function of time, interpolated as joint_trajectory_controller does.

    Linear between positions; cubic if there are velocities, quintic if there are accelerations,
    too. `start` (shape (n,), rad) is where the arm stands at 0 s.
    """

    def __init__(self, trajectory: Trajectory, start: Array) -> None:
        parts = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
        self._times = trajectory.times
        self._parts = [part for part in parts if part is not None]
        if trajectory.velocities is None:
            self._parts = self._parts[:1]
        if trajectory.times[0] > 0.0:
            self._times = np.concatenate([[0.0], trajectory.times])
            rest = np.zeros_like(start)
            first = (start, rest, rest)
            self._parts = [
                np.vstack([row, part]) for row, part in zip(first, self._parts, strict=False)
            ]

    def at(self, time: float) -> tuple[Array, Array]:
        """Return positions and velocities, shape (n,), rad and rad/s, at `time` s."""
        times, last = self._times, len(self._times) - 1
        if time >= times[last]:
            return self._parts[0][last], np.zeros_like(self._parts[0][last])
        begin = max(int(np.searchsorted(times, time, side='right')) - 1, 0)
        step = float(times[begin + 1] - times[begin])
        share = max(time - float(times[begin]), 0.0) / step
        # a Hermite polynomial of the share s in 0 … 1: derivatives count in steps
        ends = [part[begin : begin + 2] * step**order for order, part in enumerate(self._parts)]
        coefficients = _polynomial(ends)
        powers = np.arange(len(coefficients))
        positions = (share**powers) @ coefficients
        slopes = (powers[1:] * share ** powers[:-1]) @ coefficients[1:]
        return positions, slopes / step


def _polynomial(ends: list[Array]) -> Array:
    """Return coefficients, shape (degree + 1, n), from values and derivatives at 0 and 1."""
    p0, way = ends[0][0], ends[0][1] - ends[0][0]
    if len(ends) == 1:
        return np.array([p0, way])
    v0, v1 = ends[1]
    if len(ends) == 2:
        return np.array([p0, v0, 3 * way - 2 * v0 - v1, -2 * way + v0 + v1])
    a0, a1 = ends[2]
    return np.array(
        [
            p0,
            v0,
            a0 / 2,
            10 * way - 6 * v0 - 4 * v1 - (3 * a0 - a1) / 2,
            -15 * way + 8 * v0 + 7 * v1 + (3 * a0 - 2 * a1) / 2,
            6 * way - 3 * (v0 + v1) - (a0 - a1) / 2,
        ]
    )


class GoalClock:
    """The time on a goal's plan, s. `now` is monotonic, s; the plan begins at the first one."""

    def __init__(self, trajectory: Trajectory, start: Array, scaling: SpeedScaling, now: float):
        self.time = 0.0
        self.held = False
        """A point is held back until the factor is more than 0."""
        self.rate = scaling.factor(now)
        """How fast it ran last: 1 is the time of the plan, 0 is standing."""
        self._scaling = scaling
        self._reference = Reference(trajectory, start)
        self._times = trajectory.times
        self._factors = array('d')  # a list would take four times the memory
        self._now = now

    def sent(self, factor: float) -> None:
        """The next point was sent at this factor."""
        self._factors.append(factor)

    def advance(self, now: float, *, running: bool = True) -> None:
        """Let the time since the last call pass."""
        left, self._now = now - self._now, max(now, self._now)
        if not running or left < 0.0:
            self.rate = 0.0
            return
        while left > 0.0:
            segment = int(np.searchsorted(self._times, self.time, side='right'))
            if segment >= len(self._factors):
                self.rate = 0.0 if self.held else self._scaling.factor(now)
                self.time += left * self.rate
                return
            self.rate = self._factors[segment]
            end = float(self._times[segment])
            needed = (end - self.time) / self.rate
            if needed > left:
                self.time += left * self.rate
                return
            self.time = end
            left -= needed

    def desired(self) -> tuple[Array, Array]:
        """Return where the arm should be and how fast now, shape (n,), rad and rad/s."""
        positions, velocities = self._reference.at(self.time)
        return positions, velocities * self.rate
