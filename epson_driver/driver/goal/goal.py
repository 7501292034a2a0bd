# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A goal in the controller's joint order, its checks, and the check whether it is reached."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.driver.remedy import Remedy
from epson_driver.motion import Array, JointLimits, Trajectory, problems
from epson_driver.profiles.profile import StateProfile
from epson_driver.simple_message import Message


@dataclass(frozen=True, slots=True, eq=False)
class Tolerances:
    """Maximum errors of each joint, rad and rad/s, shape (n,). inf: no limit."""

    position: Array
    velocity: Array

    @property
    def checked(self) -> bool:
        return bool(np.isfinite(self.position).any() or np.isfinite(self.velocity).any())

    def violation(
        self,
        names: Sequence[str],
        position_error: Array,
        velocity_error: Array,
        unit: Callable[[int], str] = lambda _: 'rad',
    ) -> str | None:
        """Return the worst excess of a tolerance as text, or None. Position errors come first."""
        for quantity, errors, limits, per in (
            ('position', position_error, self.position, ''),
            ('velocity', velocity_error, self.velocity, '/s'),
        ):
            excess = np.abs(errors) - limits
            worst = int(np.argmax(excess))
            if excess[worst] > 0.0:
                return (
                    f'{names[worst]}: the {quantity} error is '
                    f'{abs(errors[worst]):.6g} {unit(worst)}{per}, '
                    f'the tolerance is {limits[worst]:.6g} {unit(worst)}{per}'
                )
        return None


@dataclass(frozen=True, eq=False)
class Goal:
    """A trajectory in the controller's joint order, with its tolerances.

    * `goal_velocity`: velocity below which each joint counts as stopped, shape (n,), rad/s. The
      lower value of this and `GoalSettings.stopped_velocity` applies.
    * `may_end_moving`: whether the last point may have a velocity. The arm comes to rest there in
      any case.
    * `message`: SPEL+ statements that execute the whole goal by Remote Ethernet, or None.
    * `planned`: the received plan, if `trajectory` has other times. The smoothed motion does not
      exceed its velocity and acceleration. None: only the joint limits apply.
    * `remark`: text to append to the result of a goal that succeeds.

    The goal queue checks every goal before sending any part of it.
    """

    trajectory: Trajectory
    goal_tolerance: Array  # shape (n,), rad; inf disables the check of a joint
    goal_time: float  # maximum delay after the planned end, s; 0 means no limit
    goal_velocity: Array | None = None
    path_tolerance: Tolerances | None = None
    units: tuple[str, ...] = ()  # 'rad' or 'm', one per joint; empty: all rad
    may_end_moving: bool = False
    message: Message | None = None
    start: float = 0.0  # earliest start by the event loop's clock, s; 0: immediately
    planned: Trajectory | None = None
    remark: str = ''

    def unit(self, joint: int) -> str:
        return self.units[joint] if self.units else 'rad'


def late_start(start: float, now: float) -> str:
    """Return a text about the delay of a goal that starts at `now` instead of `start`, or ''."""
    if not start or now - start <= MAX_UNREPORTED_DELAY_S:
        return ''
    return f'; it started {now - start:.3g} s after its header.stamp'


MAX_MENTIONED_PROBLEMS = 5  # maximum number of violations listed in an error text
MAX_UNREPORTED_DELAY_S = 0.1  # maximum delay of a start that the outcome does not mention, s


def checked_goal(goal: Goal, limits: JointLimits) -> Goal:
    """Check a goal, and return it with positions inside the limits.

    A position that exceeds a limit only by a rounding error is set to the limit.
    """
    trajectory, names = goal.trajectory, limits.names
    if trajectory.joint_names != names:
        raise GoalRejectedError(
            ErrorCode.INVALID_JOINTS,
            f'the joints are {", ".join(trajectory.joint_names)}; '
            f'those of the controller, in its order, are {", ".join(names)}',
        )
    points = (len(trajectory.times), len(names))
    for name, values, shape in (
        ('times', trajectory.times, points[:1]),
        ('positions', trajectory.positions, points),
        ('velocities', trajectory.velocities, points),
        ('accelerations', trajectory.accelerations, points),
        ('goal_tolerance', goal.goal_tolerance, points[1:]),
        ('goal_velocity', goal.goal_velocity, points[1:]),
    ):
        if values is not None and values.shape != shape:
            raise GoalRejectedError(
                ErrorCode.INVALID_JOINTS, f'{name} has the shape {values.shape}, not {shape}'
            )
    trajectory = replace(trajectory, positions=limits.settled(trajectory.positions))
    check_limits(trajectory, limits, may_end_moving=goal.may_end_moving)
    return replace(goal, trajectory=trajectory)


def check_limits(
    trajectory: Trajectory, limits: JointLimits, *, may_end_moving: bool = False
) -> None:
    """Raise GoalRejectedError (INVALID_GOAL) if the trajectory exceeds a limit."""
    if result := list(problems(trajectory, limits)):
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, listed(result))
    if not may_end_moving and (result := list(_end_velocities(trajectory, limits))):
        remedy = Remedy.ALLOW_END_VELOCITY
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, listed(result), remedy)


def check_start(
    trajectory: Trajectory, actual: Array, limits: JointLimits, tolerance: float
) -> None:
    """Raise GoalRejectedError unless the arm can reach the first point by the point's time.

    `actual`: position of the arm.
    """
    offset = np.abs(trajectory.positions[0] - actual)
    time = float(trajectory.times[0])
    result = [
        f'{name}: the trajectory starts at {start:.6g} {unit}, '
        f'the joint is at {value:.6g} {unit}: '
        + (
            f'{difference:.6g} {unit} apart, the limit is {tolerance:g} {unit}'
            if time == 0.0
            else f'to be there after {time:g} s it would need {difference / time:.6g} {unit}/s, '
            f'the velocity limit is {velocity:.6g} {unit}/s'
        )
        for name, unit, start, value, difference, velocity in zip(
            trajectory.joint_names,
            limits.units,
            trajectory.positions[0],
            actual,
            offset,
            limits.velocity,
            strict=True,
        )
        if difference > max(tolerance, velocity * time)
    ]
    if result:
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, listed(result))


def untimed(trajectory: Trajectory, limits: JointLimits) -> Trajectory:
    """Return a trajectory with the same positions, and new times within the velocity limits.

    The first time is unchanged: 0 s means that the first point is the arm's position.
    """
    steps = np.abs(np.diff(trajectory.positions, axis=0)) / limits.velocity
    durations = np.nan_to_num(steps.max(axis=1)) * 1.01 + 1e-3
    times = np.concatenate([trajectory.times[:1], trajectory.times[0] + np.cumsum(durations)])
    return Trajectory(trajectory.joint_names, times, trajectory.positions)


def _end_velocities(trajectory: Trajectory, limits: JointLimits) -> Iterable[str]:
    if trajectory.velocities is None:
        return
    last = len(trajectory.times) - 1
    for name, unit, velocity in zip(
        trajectory.joint_names, limits.units, trajectory.velocities[-1], strict=True
    ):
        if abs(velocity) > 1e-4:
            yield (f'point {last}, {name}: the last velocity, {velocity:.6g} {unit}/s, must be 0')


def listed(violations: Sequence[str]) -> str:
    text = '; '.join(violations[:MAX_MENTIONED_PROBLEMS])
    rest = len(violations) - MAX_MENTIONED_PROBLEMS
    return f'{text}; and {rest} more' if rest > 0 else text


CAUSE_TIMEOUT_S = 0.095  # default, s. An EPSON controller sends a STATUS every 55 ms
CAUSE_TIMEOUT_MARGIN_S = 0.04  # beyond the time between two STATUS messages, s


@dataclass(frozen=True, slots=True)
class GoalSettings:
    """Tolerances and timeouts of a goal execution."""

    stopped_velocity: float = 0.01  # velocity below which a joint counts as stopped, rad/s
    reply_timeout: float = 5.0  # after the planned end of the move, s, counted at rest only
    cause_timeout: float = CAUSE_TIMEOUT_S  # for the STATUS after a point was rejected, s
    require_planned_speed: bool = True  # reject plans and streams that would run faster


def cause_timeout(state: StateProfile) -> float:
    return state.period * (state.joint_positions_per_status + 1) + CAUSE_TIMEOUT_MARGIN_S


MIN_DISPLACEMENT = 1e-3  # rad or m: a longer motion must have come closer to the goal


class Arrival:
    def __init__(self, goal: Goal) -> None:
        self._goal = goal
        self._departed = False
        self.seen = False  # whether the arm was measured away from the goal
        self._start: Array | None = None
        self._distance = np.full(len(goal.trajectory.joint_names), np.inf)

    @cached_property  # stored, because the calculation reads every point
    def _min_excursion(self) -> float:
        """Distance from the goal, rad, that the arm must have had before an arrival counts.

        Otherwise a path that ends where it starts would be complete before the arm has moved.
        """
        positions = self._goal.trajectory.positions
        last, tolerance = positions[-1], self._goal.goal_tolerance
        beyond = np.maximum(positions.max(axis=0) - last, last - positions.min(axis=0))
        excursion, finite = float(beyond.max()), tolerance[np.isfinite(tolerance)]
        return excursion / 2 if excursion > 2 * float(finite.max(initial=0.0)) else 0.0

    def update(self, positions: Array) -> None:
        self._distance = np.abs(positions - self._goal.trajectory.positions[-1])
        if self._start is None:
            self._start = self._distance
        self.seen |= bool(np.any(self._distance > self._goal.goal_tolerance))
        self._departed |= float(self._distance.max()) >= self._min_excursion

    def reached(self, *, at_rest: bool) -> bool:
        """Return whether the arm moved and is at the goal. `at_rest`: it is reported at rest."""
        if not (self._departed and (at_rest or self._came_closer())):
            return False
        return bool(np.all(self._distance <= self._goal.goal_tolerance))

    def _came_closer(self) -> bool:
        distance = self._distance
        start = distance if self._start is None else self._start
        joint = int(np.argmax(start))
        return bool(start[joint] < MIN_DISPLACEMENT or distance[joint] < start[joint] / 2)

    def shortfall(self) -> str:
        if not self._departed:
            return 'the controller acknowledged all points, but the arm did not move'
        distance, tolerance = self._distance, self._goal.goal_tolerance
        if np.all(distance <= tolerance):
            return 'the arm stopped closer to its start than to the goal'
        joint = int(np.argmax(distance - tolerance))
        name, unit = self._goal.trajectory.joint_names[joint], self._goal.unit(joint)
        return (
            f'the arm is at rest, but {name} is {distance[joint]:.6g} {unit} from the goal: '
            f'the tolerance is {tolerance[joint]:.6g} {unit}'
        )
