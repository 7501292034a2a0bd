# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conversion between ROS messages and goals, trajectories, tolerances and durations."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from operator import attrgetter

import numpy as np
from builtin_interfaces.msg import Duration, Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from rclpy.clock import Clock
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.driver.goal.goal import Goal, Tolerances, untimed
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.motion import Array, Trajectory
from epson_driver.setup.setup import Setup

MAX_START_OFFSET_S = 1.0
"""Maximum time from now to the start time of a goal, s, in the past and in the future. A goal
outside this range is rejected, because the arm would move unexpectedly."""

UNSUPPORTED = ('multi_dof_trajectory', 'component_path_tolerance', 'component_goal_tolerance')
"""Fields of a goal for multi-DOF joints. They must be empty."""

EMPTY = FollowJointTrajectory.Goal()


class GoalRequests:
    """Converts FollowJointTrajectory requests to goals, using the current parameters."""

    def __init__(self, setup: Setup, clock: Clock, loop_time: Callable[[], float]) -> None:
        self._limits = setup.model.limits
        self._setup = setup
        self._clock = clock
        self._loop_time = loop_time

    def checked_goal(self, request: FollowJointTrajectory.Goal) -> Goal:
        """Return the goal of a request. The queue checks the joint limits later."""
        check_unsupported(request)
        trajectory = trajectory_from_message(request.trajectory, self._limits.names)
        planned = None
        if self._setup.values['timing'] == 'time_optimal':
            planned = trajectory if self._setup.values['plan_scaling'] else None
            trajectory = untimed(trajectory, self._limits)
        stamp = request.trajectory.header.stamp
        start = start_time(stamp, trajectory.duration, self._clock, self._loop_time)
        defaults = self._setup.goal(trajectory)
        path = self._tolerances(request.path_tolerance, 'path_tolerance', 'trajectory')
        goal = self._tolerances(request.goal_tolerance, 'goal_tolerance', 'goal')
        goal_time = duration_in_s(request.goal_time_tolerance)
        return replace(
            defaults,
            goal_tolerance=goal.position,
            goal_time=max(goal_time, 0.0) if goal_time != 0.0 else defaults.goal_time,
            goal_velocity=goal.velocity,
            path_tolerance=path if path.checked else None,
            start=start,
            planned=planned,
        )

    def _tolerances(self, messages: Sequence[JointTolerance], field: str, kind: str) -> Tolerances:
        defaults = self._setup.tolerances(kind).position
        return tolerances_from_messages(messages, field, self._limits.names, defaults)


def check_unsupported(request: FollowJointTrajectory.Goal) -> None:
    for field in UNSUPPORTED:
        if getattr(request, field) != getattr(EMPTY, field):
            raise invalid_goal(
                f'{field} must be empty: joints with several degrees of freedom are not supported',
            )


def start_time(
    stamp: Time, duration: float, clock: Clock, loop_time: Callable[[], float]
) -> float:
    """Return the start time of a trajectory on the loop's clock, s, or 0 to start immediately.

    `duration`: duration of the trajectory, s. Raises GoalRejectedError if `stamp` is more than
    MAX_START_OFFSET_S from now, or if the trajectory would already have ended.
    """
    if stamp == Time():
        return 0.0
    ahead: float = (stamp.sec * 10**9 + stamp.nanosec - clock.now().nanoseconds) * 1e-9
    oldest = min(duration, MAX_START_OFFSET_S)
    if -ahead > oldest:
        raise GoalRejectedError(
            ErrorCode.OLD_HEADER_TIMESTAMP,
            f'header.stamp is {-ahead:.3g} s ago: must be at most {oldest:.3g} s, by the clock of '
            'the driver (0 starts immediately)',
        )
    if ahead > MAX_START_OFFSET_S:
        raise invalid_goal(
            f'header.stamp is {ahead:.3g} s in the future: must be at most '
            f'{MAX_START_OFFSET_S:g} s, by the clock of the driver',
        )
    return loop_time() + ahead


def trajectory_from_message(message: JointTrajectory, joint_names: Sequence[str]) -> Trajectory:
    """Return a message as a Trajectory in the order of `joint_names`."""
    names = tuple(message.joint_names)
    if len(set(names)) != len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise GoalRejectedError(
            ErrorCode.INVALID_JOINTS, f'joint_names has {", ".join(twice)} twice'
        )
    missing = [name for name in joint_names if name not in names]
    unknown = [name for name in names if name not in joint_names]
    if missing or unknown:
        raise GoalRejectedError(
            ErrorCode.INVALID_JOINTS,
            '; '.join(
                [f'joint_names lacks {", ".join(missing)}'] * bool(missing)
                + [f'unknown joints in joint_names: {", ".join(map(repr, unknown))}']
                * bool(unknown)
            ),
        )
    if not message.points:
        raise invalid_goal('the trajectory has no points')
    for index, point in enumerate(message.points):
        if any(point.effort):
            raise invalid_goal(
                f'point {index}: effort must be empty or 0, because controllers accept none',
            )
    trajectory = Trajectory(
        names,
        _times(message.points),
        _table(message.points, 'positions', names),
        _optional_table(message.points, 'velocities', names),
        _optional_table(message.points, 'accelerations', names),
    )
    return trajectory.in_order(tuple(joint_names))


def _optional_table(
    points: Sequence[JointTrajectoryPoint], quantity: str, names: Sequence[str]
) -> Array | None:
    if not any(map(attrgetter(quantity), points)):
        return None
    return _table(points, quantity, names)


def _table(points: Sequence[JointTrajectoryPoint], quantity: str, names: Sequence[str]) -> Array:
    rows = list(map(attrgetter(quantity), points))
    if set(map(len, rows)) != {len(names)}:
        index, count = next(
            (index, len(row)) for index, row in enumerate(rows) if len(row) != len(names)
        )
        raise invalid_goal(f'point {index}: {count} {quantity} for {len(names)} joints')
    # each row is an array('d'), so the concatenated bytes are the table
    return np.frombuffer(b''.join(rows)).reshape(len(rows), len(names))


def _times(points: Sequence[JointTrajectoryPoint]) -> Array:
    """Return the points' time_from_start, s, like `duration_in_s` for each point."""
    durations = list(map(attrgetter('time_from_start'), points))
    seconds = np.fromiter(map(attrgetter('sec'), durations), float, len(durations))
    nanoseconds = np.fromiter(map(attrgetter('nanosec'), durations), float, len(durations))
    return seconds + nanoseconds * 1e-9


def tolerances_from_messages(
    messages: Iterable[JointTolerance], field: str, joint_names: Sequence[str], defaults: Array
) -> Tolerances:
    """Return the tolerances in a goal's field of type JointTolerance[].

    As in joint_trajectory_controller, 0 selects the default, and a negative number disables the
    check. `defaults`: default tolerances of the positions, shape (n,), rad (m). A default of 0
    disables the check.
    """
    values = {
        'position': np.where(defaults > 0.0, defaults, np.inf),
        'velocity': np.full(len(joint_names), np.inf),
    }
    seen: set[str] = set()
    for message in messages:
        if message.name not in joint_names:
            raise GoalRejectedError(
                ErrorCode.INVALID_JOINTS, f'{field} names the unknown joint {message.name!r}'
            )
        if message.name in seen:
            raise GoalRejectedError(ErrorCode.INVALID_JOINTS, f'{field} has {message.name} twice')
        seen.add(message.name)
        for quantity in ('position', 'velocity', 'acceleration'):
            value = getattr(message, quantity)
            if not np.isfinite(value):
                raise invalid_goal(
                    f'{field}, {message.name}: {quantity} = {value} is not finite',
                )
            if quantity in values:
                if value != 0.0:
                    index = joint_names.index(message.name)
                    values[quantity][index] = value if value > 0.0 else np.inf
            elif value > 0.0:
                raise invalid_goal(
                    f'{field}, {message.name}: {quantity} = {value:g} must be 0: the '
                    f'controller reports no accelerations',
                )
    return Tolerances(values['position'], values['velocity'])


def invalid_goal(text: str) -> GoalRejectedError:
    return GoalRejectedError(ErrorCode.INVALID_GOAL, text)


def duration_in_s(message: Duration | Time) -> float:
    seconds: float = message.sec + message.nanosec * 1e-9
    return seconds


def duration_message(seconds: float) -> Duration:
    sec, nanosec = divmod(round(seconds * 1e9), 10**9)
    return Duration(sec=sec, nanosec=nanosec)


def trajectory_message(trajectory: Trajectory) -> JointTrajectory:
    message = JointTrajectory(joint_names=list(trajectory.joint_names))
    for index, time_from_start in enumerate(trajectory.times):
        point = JointTrajectoryPoint(
            positions=trajectory.positions[index].tolist(),
            time_from_start=duration_message(float(time_from_start)),
        )
        if trajectory.velocities is not None:
            point.velocities = trajectory.velocities[index].tolist()
        if trajectory.accelerations is not None:
            point.accelerations = trajectory.accelerations[index].tolist()
        message.points.append(point)
    return message
