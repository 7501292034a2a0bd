# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The planned state of a goal over time, and the next point to send, with speed scaling.

Rules for the clock of a plan:
1. It starts with the first point and runs regardless of the arm. An arm that stops at each point
   therefore falls behind the plan.
2. A segment runs at the speed factor with which its last point was sent. A later change of the
   factor does not affect points that the controller has acknowledged. Segments that were not sent
   run at the current factor.
3. It stops while the controller is paused, and when the goal is stopped or paused.
"""

import math
from array import array
from dataclasses import replace
from typing import TypeVar

import numpy as np

from epson_driver.driver.delivery.delivery import PreparedTrajectory
from epson_driver.driver.delivery.trajectory_points import MIN_DURATION_S, MIN_VELOCITY
from epson_driver.motion import Array, Trajectory
from epson_driver.motion.interpolation import Interpolation
from epson_driver.simple_message import JointTrajPt, JointTrajPtFull, Message

RAMP_PER_S = 2.0
"""Rate of change of the speed factor, 1/s. A ramp from 0 to 1 takes 0.5 s."""

MIN_FACTOR = 0.01
"""Minimum speed factor other than 0. A smaller one would make points take too long."""

M = TypeVar('M', bound=Message)


class SpeedScaling:
    """Factor by which the speed of all motions is scaled, from 0 (a pause) to 1 (as planned).

    It changes gradually, except to 0. `by_velocity`: the controller uses the velocities of points.
    Times (`now`) are monotonic, s.
    """

    def __init__(self, *, by_velocity: bool = True) -> None:
        self._by_velocity = by_velocity
        self._from = 1.0
        self._target = 1.0
        self._since = -math.inf

    @property
    def target(self) -> float:
        """The requested speed factor."""
        return self._target

    def set(self, factor: float, now: float, *, ramp: bool = True) -> None:
        """Set the requested speed factor. `ramp`: change to it gradually instead of immediately.

        Raises ValueError if the factor is out of range.
        """
        if not (factor == 0.0 or MIN_FACTOR <= factor <= 1.0):
            raise ValueError(
                f'the factor {factor:g} must be 0 (pause) or from {MIN_FACTOR:g} to 1 (as planned)'
            )
        start = self.factor(now) if ramp else factor
        self._from, self._target, self._since = start, factor, now

    def start_from_rest(self, now: float) -> None:
        """Increase the factor from 0 to the requested one, for an arm at rest during a plan."""
        self._from, self._since = 0.0, now

    def factor(self, now: float) -> float:
        """Return the speed factor at `now`, which must not be before the last call of `set`."""
        change = self._target - self._from
        if not change or not self._target:
            return self._target
        done = max(now - self._since, 0.0) * RAMP_PER_S
        if done >= abs(change):
            return self._target
        return self._from + (done if change > 0.0 else -done)

    def least(self, message: Message) -> float:
        """Return the minimum speed factor for a point's message, or 0 if it has no minimum.

        A lower factor would need a velocity below MIN_VELOCITY, which is never sent.
        """
        if not (self._by_velocity and isinstance(message, JointTrajPt)):
            return 0.0
        return MIN_VELOCITY / message.velocity

    def time_for(self, planned: float, now: float) -> float:
        """Return how long a section of a plan takes from `now`, s, while the factor may change.

        `planned`: duration of the section at factor 1, s. The requested factor must not be 0.
        """
        factor = self.factor(now)
        if factor == self._target:
            return planned / factor
        ramp = abs(self._target - factor) / RAMP_PER_S
        in_ramp = (factor + self._target) / 2 * ramp
        if planned > in_ramp:
            return ramp + (planned - in_ramp) / self._target
        slope = RAMP_PER_S if self._target > factor else -RAMP_PER_S
        # planned = factor · t + slope · t² / 2, the form that is exact for small t
        root = math.sqrt(max(factor * factor + 2 * slope * planned, 0.0))
        return 2 * planned / (factor + root)


def scaled(message: M, factor: float, delay: float) -> M:
    """Return a point's message at `factor` (0, 1] of its planned speed.

    `delay` is the delay of the point relative to the plan, s. Only JOINT_TRAJ_PT_FULL uses it,
    because its time counts from the start of the trajectory.
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
    """A trajectory as a function of time, with the polynomials of joint_trajectory_controller.

    `start`: position of the arm at 0 s, shape (n,), rad.
    """

    def __init__(self, trajectory: Trajectory, start: Array) -> None:
        parts = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
        self._last = trajectory.positions[-1]
        self._end = trajectory.duration
        self._first_time = float(trajectory.times[0])
        self._first = Interpolation(
            np.array([0.0, self._first_time]),
            np.stack([start, trajectory.positions[0]]),
            *(
                None if part is None else np.stack([np.zeros_like(start), part[0]])
                for part in parts[1:]
            ),
        )
        """Segment from the arm's position to the first point, if the point's time is not 0."""
        self._interpolation = Interpolation(trajectory.times, *parts)

    def at(self, time: float) -> tuple[Array, Array]:
        """Return positions and velocities, shape (n,), rad and rad/s, at `time` s."""
        if time >= self._end:
            return self._last, np.zeros_like(self._last)
        time = max(time, 0.0)
        part = self._first if time < self._first_time else self._interpolation
        positions, velocities, _ = part.at(time)
        return positions, velocities


class GoalClock:
    """Clock of a goal's plan time. It starts at 0 at `now`. All times are monotonic, s."""

    def __init__(self, trajectory: Trajectory, start: Array, scaling: SpeedScaling, now: float):
        self.time = 0.0
        self.rate = scaling.factor(now)
        """Current rate of the clock: 1 at the planned speed, 0 while stopped."""
        self._scaling = scaling
        self._reference = ReferenceTrajectory(trajectory, start)
        self._times = trajectory.times
        self._factors = array('d')  # a list would take four times the memory
        self._now = now

    def sent(self, factor: float) -> None:
        """Record the speed factor of the point just sent."""
        self._factors.append(factor)

    def advance(self, now: float, *, running: bool = True) -> None:
        """Advance by the time since the last call. If not `running`, only set `rate` to 0."""
        remaining, self._now = now - self._now, max(now, self._now)
        if not running or remaining < 0.0:
            self.rate = 0.0
            return
        while remaining > 0.0:
            segment = int(np.searchsorted(self._times, self.time, side='right'))
            if segment >= len(self._factors):
                self.rate = self._scaling.factor(now)
                self.time += remaining * self.rate
                return
            self.rate = self._factors[segment]
            end = float(self._times[segment])
            needed = (end - self.time) / self.rate
            if needed > remaining:
                self.time += remaining * self.rate
                return
            self.time = end
            remaining -= needed

    def desired(self) -> tuple[Array, Array]:
        """Return the planned positions and velocities, shape (n,), rad and rad/s."""
        positions, velocities = self._reference.at(self.time)
        return positions, velocities * self.rate


class PointSchedule:
    """Scales the messages of one trajectory to the current speed factor.

    `start`: position of the arm at rest, shape (n,), rad. `start_by`: latest time at which the
    controller starts the motion, monotonic, s.
    """

    def __init__(
        self,
        prepared: PreparedTrajectory,
        start: Array,
        scaling: SpeedScaling,
        start_by: float,
    ) -> None:
        self.clock = GoalClock(prepared.trajectory, start, scaling, start_by)
        self.duration = 0.0
        """Duration of the last point that was sent, s."""
        self._sent_until = start_by
        self._scaling = scaling
        self._delay = 0.0
        self._times = prepared.trajectory.times.data  # gives floats, as an array does not
        self._messages = prepared.messages

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self._messages)

    def ahead(self, index: int) -> float:
        """Return the plan time left until point `index`, s, or 0 if the clock has passed it."""
        return max(self._times[index] - self.clock.time, 0.0)

    def message(self, index: int, now: float) -> Message:
        """Return the message of point `index`, scaled to the speed factor, which must not be 0.

        Points must be requested in order, when they are sent.
        """
        before = self._times[index - 1] if index else 0.0
        planned = max(self._times[index] - before, MIN_DURATION_S)
        start = max(now, self._sent_until)  # after the earlier points
        message = self._messages[index]
        factor = planned / self._scaling.time_for(planned, start)
        factor = max(factor, self._scaling.least(message))
        duration = planned / factor
        self._sent_until = start + duration
        self._delay += duration - planned
        message = scaled(message, factor, self._delay)
        self.duration = max(duration, getattr(message, 'duration', 0.0))
        self.clock.sent(factor)
        return message
