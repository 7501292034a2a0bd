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
from collections.abc import Sequence

import numpy as np

from epson_driver.driver.goal.speed_scaling import SpeedScaling
from epson_driver.motion import Array, Trajectory
from epson_driver.motion.interpolation import Interpolation


class Reference:
    """A trajectory as a function of time, interpolated as joint_trajectory_controller does.

    `start` (shape (n,), rad) is where the arm stands at 0 s.
    """

    def __init__(self, trajectory: Trajectory, start: Array) -> None:
        parts = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
        self._last = trajectory.positions[-1]
        self._end = trajectory.duration
        self._begin = float(trajectory.times[0])
        self._first = Interpolation(
            np.array([0.0, self._begin]),
            np.stack([start, trajectory.positions[0]]),
            *(
                None if part is None else np.stack([np.zeros_like(start), part[0]])
                for part in parts[1:]
            ),
        )
        """From where the arm stands to the first point, if that has a time."""
        self._interpolation = Interpolation(trajectory.times, *parts)

    def at(self, time: float) -> tuple[Array, Array]:
        """Return positions and velocities, shape (n,), rad and rad/s, at `time` s."""
        if time >= self._end:
            return self._last, np.zeros_like(self._last)
        time = max(time, 0.0)
        part = self._first if time < self._begin else self._interpolation
        positions, velocities, _ = part.at(time)
        return positions, velocities


class GoalClock:
    """The time on a goal's plan, s. `now` is monotonic, s; the plan begins at the first one.

    `sent`: the factors with which its first points were sent already, as those of another goal.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        start: Array,
        scaling: SpeedScaling,
        now: float,
        sent: Sequence[float] = (),
    ):
        self.time = 0.0
        self.held = False
        """A point is held back until the factor is more than 0."""
        self.rate = scaling.factor(now)
        """How fast it ran last: 1 is the time of the plan, 0 is standing."""
        self._scaling = scaling
        self._reference = Reference(trajectory, start)
        self._times = trajectory.times
        self._factors = array('d', sent)  # a list would take four times the memory
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

    @property
    def seen(self) -> float:
        """When it was at `time`, monotonic, s."""
        return self._now

    @property
    def factors(self) -> Sequence[float]:
        """The factors with which points were sent, so far."""
        return self._factors

    def planned(self) -> tuple[Array, Array]:
        """Return where the plan is now and how fast it is, shape (n,), rad and rad/s."""
        return self._reference.at(self.time)

    def desired(self) -> tuple[Array, Array]:
        """Return where the arm should be and how fast now, shape (n,), rad and rad/s."""
        positions, velocities = self.planned()
        return positions, velocities * self.rate
