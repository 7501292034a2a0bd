# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conversion between ROS messages and trajectories, tolerances and durations."""

from collections.abc import Iterable, Sequence
from operator import attrgetter

import numpy as np
from builtin_interfaces.msg import Duration, Time
from control_msgs.msg import JointTolerance
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.driver.goal.goal import Tolerances
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.motion import Array, Trajectory


def trajectory_from_message(message: JointTrajectory, joint_names: Sequence[str]) -> Trajectory:
    """Return a message as a Trajectory in the order of `joint_names`.

    Raises GoalRejectedError with INVALID_JOINTS if the message has other joints. Raises it with
    INVALID_GOAL if there are no points, or if a point lacks positions, has efforts, or has an
    array of the wrong length.
    """
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
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, 'the trajectory has no points')
    for index, point in enumerate(message.points):
        if any(point.effort):
            raise GoalRejectedError(
                ErrorCode.INVALID_GOAL,
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
    """Return a quantity of all points, shape (points, n), or None if no point has it."""
    if not any(map(attrgetter(quantity), points)):
        return None
    return _table(points, quantity, names)


def _table(points: Sequence[JointTrajectoryPoint], quantity: str, names: Sequence[str]) -> Array:
    """Return a quantity of all points, shape (points, n)."""
    rows = list(map(attrgetter(quantity), points))
    if set(map(len, rows)) != {len(names)}:
        index, count = next(
            (index, len(row)) for index, row in enumerate(rows) if len(row) != len(names)
        )
        raise GoalRejectedError(
            ErrorCode.INVALID_GOAL, f'point {index}: {count} {quantity} for {len(names)} joints'
        )
    # each row is an array('d'), so the concatenated bytes are the table
    return np.frombuffer(b''.join(rows)).reshape(len(rows), len(names))


def _times(points: Sequence[JointTrajectoryPoint]) -> Array:
    """Return the points' time_from_start, s. It is a vectorized `duration_in_s`."""
    durations = list(map(attrgetter('time_from_start'), points))
    seconds = np.fromiter(map(attrgetter('sec'), durations), float, len(durations))
    nanoseconds = np.fromiter(map(attrgetter('nanosec'), durations), float, len(durations))
    return seconds + nanoseconds * 1e-9


def tolerances_from_messages(
    messages: Iterable[JointTolerance], field: str, joint_names: Sequence[str], defaults: Array
) -> Tolerances:
    """Return the tolerances in a field of a goal, which is a JointTolerance[].

    0 selects the default, and a negative number disables the check, as in
    joint_trajectory_controller. `defaults`: for positions, shape (n,), rad (m), where 0 disables
    the check. Velocities have no default. Raises GoalRejectedError if a joint is unknown or
    repeated, a number is not finite, or an acceleration has a tolerance.
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
                raise GoalRejectedError(
                    ErrorCode.INVALID_GOAL,
                    f'{field}, {message.name}: {quantity} = {value} is not finite',
                )
            if quantity in values:
                if value != 0.0:
                    index = joint_names.index(message.name)
                    values[quantity][index] = value if value > 0.0 else np.inf
            elif value > 0.0:
                raise GoalRejectedError(
                    ErrorCode.INVALID_GOAL,
                    f'{field}, {message.name}: {quantity} = {value:g} must be 0: the '
                    f'controller reports no accelerations',
                )
    return Tolerances(values['position'], values['velocity'])


def duration_in_s(message: Duration | Time) -> float:
    """Return a builtin_interfaces Duration or Time in s."""
    seconds: float = message.sec + message.nanosec * 1e-9
    return seconds


def trajectory_message(trajectory: Trajectory) -> JointTrajectory:
    """Return a trajectory as a ROS message."""
    message = JointTrajectory(joint_names=list(trajectory.joint_names))
    for index, time_from_start in enumerate(trajectory.times):
        sec, nanosec = divmod(round(float(time_from_start) * 1e9), 10**9)
        point = JointTrajectoryPoint(
            positions=trajectory.positions[index].tolist(),
            time_from_start=Duration(sec=sec, nanosec=nanosec),
        )
        if trajectory.velocities is not None:
            point.velocities = trajectory.velocities[index].tolist()
        if trajectory.accelerations is not None:
            point.accelerations = trajectory.accelerations[index].tolist()
        message.points.append(point)
    return message
