# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Where a goal should be now, and which point may be sent: its plan, a clock, the speed scaling.

Rules:
1. The clock runs from when the first point is sent, whatever the controller makes of the points:
   one that rests at each point falls behind it.
2. In a segment whose end was sent, it runs at the factor with which that point was sent: what the
   controller has acknowledged is not changed by a later factor. Beyond, it runs at the factor of
   the moment; while points are held back, it stops.
   A controller that scales the speed itself goes at the factor of the moment everywhere. How it
   gets to another one is seen: the clock stays as far ahead of the arm as it was before.
3. While the controller is paused, and once the goal is being stopped, it stands.
"""

import math
from array import array
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from epson_driver.driver.delivery.trajectory_points import MIN_DURATION_S, MIN_VELOCITY
from epson_driver.driver.goal.lead import Lead
from epson_driver.motion import Array, Trajectory
from epson_driver.motion.interpolation import Interpolation
from epson_driver.simple_message import JointTrajPt, JointTrajPtFull, Message

RAMP_PER_S = 2.0
"""How fast the factor changes, 1/s: half a second from a pause to full speed."""

SETTLING_S = 3.0
"""How long a controller may take that goes to another factor by itself, s."""

MIN_FACTOR = 0.01
"""The smallest factor but 0. Below it, points would take longer than anybody waits."""

MIN_SQUARE = 1e-4
"""Of a plan's velocity, (rad/s)²: a slower one does not show how far the arm is."""

M = TypeVar('M', bound=Message)


class SpeedScaling:
    """A factor that goes to its target in a ramp. Times (`now`) are monotonic, s.

    `by_velocity`: points are for a controller that goes by their velocities. `fixed`: why there is
    no other factor than 1, or ''.
    """

    def __init__(self, *, by_velocity: bool = True, fixed: str = '') -> None:
        self._by_velocity = by_velocity
        self._fixed = fixed
        self._from = 1.0
        self._target = 1.0
        self._since = -math.inf
        self.at_once = False
        """The controller goes at the factor of any moment: points are sent as they are planned."""
        self.in_smoother = False
        """The driver's own smoother acts on the points of goals: those not sent yet."""
        self.on_set: Callable[[], None] = lambda: None
        """Called when another factor was asked for."""

    @property
    def target(self) -> float:
        """The factor that was asked for."""
        return self._target

    def set(self, factor: float, now: float) -> None:
        """Go to another factor from now on. Raises ValueError that names the allowed range."""
        if not (factor == 0.0 or MIN_FACTOR <= factor <= 1.0):
            raise ValueError(
                f'the factor {factor:g} must be 0 (pause) or from {MIN_FACTOR:g} to 1 (as planned)'
            )
        if self._fixed and factor != 1.0:
            raise ValueError(f'factor = {factor:g}: {self._fixed}')
        self._from, self._target, self._since = self.factor(now), factor, now
        self.on_set()

    def pace(self, now: float) -> float:
        """Return the factor at which the controller goes with what it has."""
        return self.factor(now) if self.at_once else 1.0

    def between(self, now: float) -> tuple[float, float] | None:
        """Return the least and the greatest speed of a controller that gets to another factor.

        It takes a ramp of its own for that. None: it is there.
        """
        if now > self._since + SETTLING_S:
            return None
        return min(self._from, self._target), max(self._from, self._target)

    def factor(self, now: float) -> float:
        """Return the factor at a moment after the last `set`."""
        way = self._target - self._from
        if not way:
            return self._target
        done = max(now - self._since, 0.0) * RAMP_PER_S
        if done >= abs(way):
            return self._target
        return self._from + (done if way > 0.0 else -done)

    def least(self, message: Message) -> float:
        """Return the factor (0, 1] below which a point cannot be sent, or 0 if there is none.

        No velocity is below MIN_VELOCITY: the arm would be faster than its clock.
        """
        if not (self._by_velocity and isinstance(message, JointTrajPt)):
            return 0.0
        return MIN_VELOCITY / message.velocity

    def time_for(self, planned: float, now: float) -> float | None:
        """Return how long `planned` s of a plan take from now on, s, or None if they stop.

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


class ReferenceTrajectory:
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
    """The time on a goal's plan, which begins at the first `now`. Times are monotonic, s.

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
        self._reference = ReferenceTrajectory(trajectory, start)
        self._times = trajectory.times
        self._factors = array('d', sent)  # a list would take four times the memory
        self._now = now
        self._passed = 0.0
        self._behind = 0.0
        """How far the arm is behind it while the factor does not change, s of its time."""

    def replace(self, trajectory: Trajectory, start: Array) -> None:
        """Go on with another plan, which is the same as far as points were sent."""
        self._reference = ReferenceTrajectory(trajectory, start)
        self._times = trajectory.times

    def sent(self, factor: float) -> None:
        """Record the speed factor of the point just sent."""
        self._factors.append(factor)

    def advance(self, now: float, *, running: bool = True) -> None:
        """Let the time since the last call pass."""
        left, self._now = now - self._now, max(now, self._now)
        self._passed = max(left, 0.0)
        if not running or left < 0.0:
            self.rate = 0.0
            return
        while left > 0.0:
            segment = int(np.searchsorted(self._times, self.time, side='right'))
            if self._scaling.at_once or segment >= len(self._factors):
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

    def follow(self, actual: Array) -> None:
        """Keep to an arm that is at `actual`, shape (n,), rad, on its way to another factor."""
        planned, velocity = self.planned()
        square = float(velocity @ velocity)
        if square < MIN_SQUARE:
            return
        behind = float((planned - actual) @ velocity) / square
        bounds = self._scaling.between(self._now)
        if bounds is None:
            self._behind = behind / self.rate if self.rate else 0.0
            return
        wanted = self._behind * self.rate - behind
        least, most = ((bound - self.rate) * self._passed for bound in bounds)
        self.time += min(max(wanted, least), most)

    @property
    def seen(self) -> float:
        """Monotonic time at which the plan was at `time`, s."""
        return self._now

    @property
    def factors(self) -> Sequence[float]:
        """The factors with which points were sent, so far."""
        return self._factors

    def planned(self) -> tuple[Array, Array]:
        """Return the plan's position and velocity now, shape (n,), rad and rad/s."""
        return self._reference.at(self.time)

    def desired(self) -> tuple[Array, Array]:
        """Return where the arm should be and how fast now, shape (n,), rad and rad/s."""
        positions, velocities = self.planned()
        return positions, velocities * self.rate


class PointSchedule:
    """Scales the messages of one trajectory to the speed of the moment, and keeps its clock.

    `start`: shape (n,), rad, where the arm stands. `begins_by`: when the controller begins to move
    it at the latest, monotonic, s. `lead`: how far ahead of the clock points are sent, or
    None.

    `sent`: the factors with which its first points were sent already, as those of another goal,
    and `sent_until`: when the last of them is reached, monotonic, s.

    `scaled_from`: the index of the first point that is part of a motion with the scaling in it
    (rescaling.py).
    """

    def __init__(
        self,
        trajectory: Trajectory,
        messages: Sequence[Message],
        start: Array,
        scaling: SpeedScaling,
        begins_by: float,
        *,
        lead: Lead | None = None,
        sent: Sequence[float] = (),
        sent_until: float = 0.0,
        scaled_from: int | None = None,
    ) -> None:
        pace = scaling if scaled_from is None else SpeedScaling()
        self.clock = GoalClock(trajectory, start, pace, begins_by, sent)
        self.duration = max(sent_until - begins_by, 0.0)
        """How long the point that was sent last takes, s, or what was sent before."""
        self.waits = False
        """A point is held back, for the speed scaling or as it is too far ahead of the clock."""
        self.sent_until = max(begins_by, sent_until)
        """When what was sent ends, monotonic, s."""
        self._start = start
        self._scaling = scaling
        self._pace = pace
        self.scaled_from = scaled_from or 0
        self._lead = lead
        self._delay = 0.0
        self._take(trajectory, messages)

    def _take(self, trajectory: Trajectory, messages: Sequence[Message]) -> None:
        self._times = trajectory.times.data  # gives floats, as an array does not
        self._messages = messages
        self._stops = [] if self._lead is None else self._lead.stops(trajectory)
        self.known = len(messages)
        """So many points may be sent."""

    def replace(self, trajectory: Trajectory, messages: Sequence[Message], known: int) -> None:
        """Go on with other points after those that were sent, of which so many are known."""
        self.clock.replace(trajectory, self._start)
        self._take(trajectory, messages)
        self.known = known

    def hold(self, patience: float) -> None:
        """Send no more points than what the controller has, and what is due in `patience` s."""
        due = bisect_right(self._times, self.clock.time + patience)
        self.known = min(max(self.count, due, self.scaled_from), self.known)

    def __len__(self) -> int:
        """How many points there are, so far."""
        return len(self._messages)

    @property
    def count(self) -> int:
        """How many points were sent."""
        return len(self.clock.factors)

    def ahead(self, index: int) -> float:
        """Return how far ahead of the clock a point is, s, or 0 if it is not."""
        return max(self._times[index] - self.clock.time, 0.0) if index >= 0 else 0.0

    def _enough(self, index: int) -> bool:
        """Return whether what was sent, up to the point before, reaches far enough ahead."""
        if self._lead is None or index == 0:
            return False
        time = self.clock.time
        ahead = self._times[index - 1] - time - self._lead.latency
        begun = max(bisect_right(self._times, time, hi=index) - 1, 0)
        return ahead > max(self._stops[begun : index - 1], default=0.0)

    def message(self, index: int, now: float) -> Message | None:
        """Return the point to send now, or None if it is held back.

        That is as long as the factor is 0, while what was sent reaches far enough ahead, and until
        it is known.
        """
        if index >= self.known:
            self.clock.held = self.waits = True
            return None
        scaling = self._scaling if index < self.scaled_from else self._pace
        before = self._times[index - 1] if index else 0.0
        planned = max(self._times[index] - before, MIN_DURATION_S)
        begin = max(now, self.sent_until)  # it runs after what was sent before
        takes = scaling.time_for(planned, begin)
        if scaling.at_once:
            takes = planned if scaling.factor(now) or scaling.target else None
        self.clock.held = takes is None
        self.waits = takes is None or self._enough(index)
        if takes is None or self.waits:
            return None
        message = self._messages[index]
        factor = max(planned / takes, scaling.least(message))
        takes = planned / factor
        self.sent_until = begin + takes
        self._delay += takes - planned
        message = scaled(message, factor, self._delay)
        self.duration = max(takes, getattr(message, 'duration', 0.0))
        self.clock.sent(factor)
        return message
