# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The timing of a goal's plan: its clock, its speed scaling, and its remainder after a pause.

Rules for the clock of a plan:

1. It starts with the first point and runs regardless of the arm. Therefore an arm that stops at
   each point falls behind the plan.
2. A segment runs at the speed factor with which its last point was sent. A later change of the
   factor does not affect points that the controller has acknowledged. Segments that have not been
   sent run at the current factor. On a controller that scales all of its motion (`actual`), every
   segment runs at the factor of the arm.
3. The clock stops while the controller is paused, and when the goal is stopped or paused.

After a pause the arm is not at a planned point, and no controller reports how much of the plan it
has executed. Therefore the remainder of the plan (`remainder`) starts at the position on the
planned path that is closest to the arm. A path may pass a position several times, for example in a
pick and place. Of several positions at about the same distance from the arm, the remainder starts
at the position whose planned time is closest to the expected time.

TimingMonitor checks whether the controller can execute a plan at the plan's speed, and whether it
has done so. Its times are plan times, which pauses and speed scaling do not change.
"""

import math
from array import array
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from epson_driver.driver.delivery.delivery import DeliveryRules, PreparedTrajectory
from epson_driver.driver.delivery.statements import FIXED_SPEED
from epson_driver.driver.delivery.streaming import MIN_DURATION_S, MIN_VELOCITY, START_MARGIN_RAD
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.driver.remedy import Remedy
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.motion.interpolation import Interpolation
from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.simple_message import JointTrajPt, JointTrajPtFull, Message

RAMP_PER_S = 2.0  # rate of change of the speed factor, 1/s
MIN_FACTOR = 0.01  # other than 0: points would take too long

M = TypeVar('M', bound=Message)


class SpeedScaling:
    """Speed factor of all motions, from 0 (a pause) to 1. It changes gradually, except to 0."""

    def __init__(self, *, by_velocity: bool = True) -> None:
        self._by_velocity = by_velocity
        self._from = 1.0
        self._target = 1.0
        self._since = -math.inf
        self.actual: Callable[[], float] | None = None  # see `Delivery.scale`

    @property
    def target(self) -> float:
        return self._target

    def set(self, factor: float, now: float, *, ramp: bool = True) -> None:
        """Set the requested speed factor. `ramp`: change gradually to a factor above 0."""
        if not (factor == 0.0 or MIN_FACTOR <= factor <= 1.0):
            raise ValueError(
                f'the factor {factor:g} must be 0 (pause) or from {MIN_FACTOR:g} to 1 (as planned)'
            )
        start = self.factor(now) if ramp else factor
        self._from, self._target, self._since = start, factor, now

    def start_from_rest(self, now: float) -> None:
        """Increase the speed factor gradually from 0, because the arm starts from rest."""
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

    def rate(self, now: float) -> float:
        """Return the factor at which the arm moves along a plan, outside the points sent."""
        return self.factor(now) if self.actual is None else self.actual()

    def least(self, message: Message) -> float:
        """Return the minimum speed factor of a point, at which its velocity is MIN_VELOCITY."""
        if not (self._by_velocity and isinstance(message, JointTrajPt)):
            return 0.0
        return MIN_VELOCITY / message.velocity

    def time_for(self, planned: float, now: float) -> float:
        """Return how long `planned` s of a plan take from `now` on, s, including a speed ramp."""
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
    """Return a point slowed down to `factor` (0, 1] of its speed, and delayed by `delay` s."""
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
    """A trajectory from `start`, interpolated as by ros2_control's trajectory controller."""

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
    """Clock of a goal's plan. Plan time 0 is the monotonic time `now`, s."""

    def __init__(self, trajectory: Trajectory, start: Array, scaling: SpeedScaling, now: float):
        self.time = 0.0
        self.rate = scaling.factor(now)  # 1 at the planned speed, 0 while stopped
        self._scaling = scaling
        self._reference = ReferenceTrajectory(trajectory, start)
        self._times = trajectory.times
        self._factors = array('d')  # a list would take four times the memory
        self._now = now

    def sent(self, factor: float) -> None:
        self._factors.append(factor)

    def advance(self, now: float, *, running: bool = True) -> None:
        """Advance to the time `now`. If the plan is not `running`, only set `rate` to 0."""
        remaining, self._now = now - self._now, max(now, self._now)
        if not running or remaining < 0.0:
            self.rate = 0.0
            return
        while remaining > 0.0:
            segment = int(np.searchsorted(self._times, self.time, side='right'))
            if segment >= len(self._factors):
                self.rate = self._scaling.rate(now)
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
        """Return the currently planned positions, rad, and velocities, rad/s, shapes (n,)."""
        positions, velocities = self._reference.at(self.time)
        return positions, velocities * self.rate


class PointSchedule:
    """The messages of a trajectory, each slowed down by the current speed scaling when it is sent.

    `start_by`: latest start of the motion, monotonic, s.
    """

    def __init__(
        self,
        prepared: PreparedTrajectory,
        start: Array,
        scaling: SpeedScaling,
        start_by: float,
    ) -> None:
        self.clock = GoalClock(prepared.trajectory, start, scaling, start_by)
        self.duration = 0.0  # duration of the last point that was sent, s
        self._sent_until = start_by
        self._scaling = scaling
        self._delay = 0.0
        self._times = prepared.trajectory.times.data  # gives floats, as an array does not
        self._messages = prepared.messages

    def __len__(self) -> int:
        return len(self._messages)

    def ahead(self, index: int) -> float:
        """Return the plan time that is left until point `index` is due, s, or 0 if it is past."""
        return max(self._times[index] - self.clock.time, 0.0)

    def message(self, index: int, now: float) -> Message:
        """Return the message of point `index`, scaled to the speed factor if the arm is not.

        Must be called in the order of sending.
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
        if self._scaling.actual is None:
            message = scaled(message, factor, self._delay)
            self.clock.sent(factor)
        self.duration = max(duration, getattr(message, 'duration', 0.0))
        return message


TIME_WEIGHT = 0.05
"""Weight of the difference from the expected time, relative to the weight of the distance from the
path. Both are in s, because the distance is divided by the plan's maximum speed."""

FROM_REST = 1.5  # factor on the time to the first point, because the arm accelerates from rest


def remainder(
    plan: Trajectory, start: Array, rest: Array, expected: float, limits: JointLimits
) -> Trajectory:
    """Return the trajectory from `rest` through the points that the arm has not passed.

    `start`: position of the arm at the start of the plan. `rest`: its current position. Both have
    the shape (n,), rad. `expected`: estimated plan time at which the arm stopped, s. Relative to
    the velocity limits, the arm moves to the first point no faster than the plan's fastest joint.
    A plan without motion is returned whole.
    """
    times, positions = plan.times, plan.positions
    added = int(times[0] > 0.0)
    if added:
        times, positions = np.append(0.0, times), np.vstack([start, positions])
    steps, durations = np.diff(positions, axis=0) / limits.velocity, np.diff(times)
    if np.max(np.abs(positions - positions[0])) < START_MARGIN_RAD:
        return plan
    fastest = float(np.max(np.abs(steps) / durations[:, None]))
    offsets = (rest - positions[:-1]) / limits.velocity
    squares = np.maximum(np.sum(steps**2, axis=1), np.finfo(float).tiny)
    fractions = np.clip(np.sum(offsets * steps, axis=1) / squares, 0.0, 1.0)
    distances = np.linalg.norm(offsets - fractions[:, None] * steps, axis=1)
    reached = times[:-1] + fractions * durations
    segment = int(np.argmin(distances / fastest + TIME_WEIGHT * np.abs(reached - expected)))
    first, last = segment + 1, len(times) - 1
    if first < last and np.max(np.abs(positions[first] - rest)) < START_MARGIN_RAD:
        first += 1
    approach = float(np.max(np.abs(positions[first] - rest) / limits.velocity))
    approach /= max(fastest, MIN_VELOCITY)  # a lower velocity is never sent
    needed = FROM_REST * max(float(times[first] - reached[segment]), approach, MIN_DURATION_S)

    def from_rest(values: Array | None) -> Array | None:
        if values is None:
            return None
        return np.vstack([np.zeros_like(rest), values[first - added :]])

    return Trajectory(
        plan.joint_names,
        np.append(0.0, needed + times[first:] - times[first]),
        np.vstack([limits.settled(rest), positions[first:]]),
        from_rest(plan.velocities),
        from_rest(plan.accelerations),
    )


MIN_DEVIATION_FRACTION = 0.2  # fraction of the planned time. A larger difference is another speed

MIN_FASTER_S, MIN_SLOWER_S = 0.3, 0.5
"""Minimum difference between actual and planned time that counts as another speed, s, for faster
and for slower motions. It is larger for slower motions, because the start delay of the controller
and the detection of standstill add to the actual time."""

MAX_FASTER = 1.25  # maximum ratio of the controller's speed to the speed of a plan's fastest joint

REMEDY = "lower the controller's own speed (in its program, or by the override of its pendant)"

WHY = {
    FieldsUsed.NOTHING: 'this controller ignores point velocities and durations',
    FieldsUsed.VELOCITY: 'this controller ignores point durations and uses the velocities',
    FieldsUsed.DURATION: 'this controller did not keep the point durations',
    FieldsUsed.BOTH: 'this controller did not keep the point durations',
}


@dataclass(frozen=True, slots=True)
class Timing:
    """Planned duration of a goal, and actual duration until the arm was at rest at the goal, s."""

    planned: float
    executed: float

    @property
    def deviates(self) -> bool:
        late = self.executed - self.planned
        minimum = MIN_SLOWER_S if late > 0.0 else MIN_FASTER_S
        return abs(late) > max(minimum, MIN_DEVIATION_FRACTION * self.planned)


class TimingMonitor:
    """Checks whether the controller supports the speed of a plan, a stream, or a speed scaling."""

    def __init__(self, rules: DeliveryRules, limits: JointLimits) -> None:
        points_have_times = rules.point_message == 'joint_traj_pt_full'
        uses = FieldsUsed.DURATION if points_have_times else rules.uses
        statements = rules.interface == 'statements'
        self.by_velocity = uses is not FieldsUsed.DURATION  # it may use velocities
        self.unplanned = uses is FieldsUsed.NOTHING and not statements
        """Whether the controller ignores the velocities and durations of points."""
        self._downloads = rules.interface == 'download'
        self._why = WHY[uses]
        self._fixed = self._no_pause = ''
        if self.unplanned:
            self._fixed = f'{self._why}: {REMEDY}'
        if statements:
            self._why = f'the controller plans motions itself (power {rules.power})'
            self._fixed = self._no_pause = FIXED_SPEED
        elif self._downloads:
            self._no_pause = 'the controller has all points of a download: stop the arm instead'
        self._speed, self._slowest = rules.speed, rules.slowest
        self._limits = limits

    def deviation(self, timing: Timing) -> str:
        if not timing.deviates:
            return ''
        return f'took {timing.executed:.3g} s instead of {timing.planned:.3g} s: {self._why}'

    def check_factor(self, factor: float, running: Trajectory | None) -> None:
        """Raise ValueError if the controller cannot execute motions at this speed scaling."""
        why = self._no_pause if factor == 0.0 else self._fixed if factor < 1.0 else ''
        if running is not None and self._downloads and factor < 1.0:
            why = why or (
                'the controller has all points of the running motion, which keeps its speed: '
                'wait for its end, or stop the arm'
            )
        if running is not None and 0.0 < factor < 1.0:
            why = why or self._too_slow(self._fastest(running, running.positions[0]) * factor)
        if why:
            raise ValueError(f'factor = {factor:g}: {why}')

    def why_no_stream(self) -> str:
        return f'no stream can keep its speed: {self._fixed}' if self.unplanned else ''

    def check(self, trajectory: Trajectory, start: Array, factor: float) -> None:
        """Raise GoalRejectedError if the controller would execute the plan faster than planned."""
        fastest = self._fastest(trajectory, start) * factor
        why = self._too_slow(fastest)
        if self.unplanned and self._speed > MAX_FASTER * fastest:
            why = (
                f'the plan moves at {fastest:.3g} of the velocity limits at most, the controller '
                f'at {self._speed:.3g}: {self._fixed}'
            )
        if why and np.max(np.abs(trajectory.positions - start)) > START_MARGIN_RAD:
            raise GoalRejectedError(ErrorCode.INVALID_GOAL, why, Remedy.ALLOW_OTHER_SPEED)

    def _too_slow(self, fastest: float) -> str:
        """Return why the controller cannot move as slowly as a plan's highest speed, or ''."""
        if self._slowest <= MAX_FASTER * fastest:
            return ''
        return (
            f'the plan moves at {fastest:.3g} of the velocity limits at most: the minimum of the '
            f'controller is {self._slowest:g}'
        )

    def _fastest(self, trajectory: Trajectory, start: Array) -> float:
        """Return the speed of a plan's fastest joint, as a fraction of its velocity limit."""
        steps = np.abs(np.diff(trajectory.positions, axis=0, prepend=start[None, :]))
        times = np.diff(trajectory.times, prepend=0.0)
        fractions = steps[times > 0.0] / times[times > 0.0][:, None] / self._limits.velocity
        if trajectory.velocities is not None:
            at_points = np.abs(trajectory.velocities) / self._limits.velocity
            fractions = np.vstack([fractions, at_points])
        return float(np.max(fractions, initial=0.0))
