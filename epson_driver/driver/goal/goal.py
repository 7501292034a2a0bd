# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A goal: what was asked, checked, in the controller's joint order."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from epson_driver.driver.goal.tolerances import Tolerances
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.motion import Array, JointLimits, Trajectory, problems

MAX_MENTIONED_PROBLEMS = 5
"""So many violations are spelled out in a goal's error text; the rest is counted."""


@dataclass(frozen=True, eq=False)
class Goal:
    """A checked trajectory in the controller's joint order and what counts as having done it.

    goal_tolerance: shape (n,), rad; inf where it is not checked. goal_time: s after the planned
    end within which the arm must be there; 0 means no limit. goal_velocity: shape (n,), rad/s,
    below which each joint counts as standing at the end, if that is less than what holds for all;
    None: no such. path_tolerance: on the way, against the plan at that moment; None: not checked.
    units: 'rad' or 'm', one per joint; all rad where nothing is said.
    """

    trajectory: Trajectory
    goal_tolerance: Array
    goal_time: float
    goal_velocity: Array | None = None
    path_tolerance: Tolerances | None = None
    units: tuple[str, ...] = ()

    def unit(self, joint: int) -> str:
        """Return the unit of a joint's position, by its index."""
        return self.units[joint] if self.units else 'rad'


def trajectory_from_message(message: Any, joint_names: Sequence[str]) -> Trajectory:
    """Return a trajectory_msgs/JointTrajectory as a Trajectory in the order of `joint_names`.

    Raises GoalRejectedError: INVALID_JOINTS unless the names are the same set, INVALID_GOAL if
    there are no points, a point has no positions, or an array has the wrong length.
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
    trajectory = Trajectory(
        names,
        np.array([duration_in_s(point.time_from_start) for point in message.points]),
        _table(message.points, 'positions', names),
        _optional(message.points, 'velocities', names),
        _optional(message.points, 'accelerations', names),
    )
    return trajectory.in_order(tuple(joint_names))


def _optional(points: Sequence[Any], quantity: str, names: Sequence[str]) -> Array | None:
    """Return None if no point has the quantity; one point that has it obliges the others."""
    if not any(len(getattr(point, quantity)) for point in points):
        return None
    return _table(points, quantity, names)


def _table(points: Sequence[Any], quantity: str, names: Sequence[str]) -> Array:
    for index, point in enumerate(points):
        count = len(getattr(point, quantity))
        if count != len(names):
            raise GoalRejectedError(
                ErrorCode.INVALID_GOAL,
                f'point {index}: {count} {quantity} for {len(names)} joints',
            )
    return np.array([getattr(point, quantity) for point in points], dtype=float)


def duration_in_s(message: Any) -> float:
    """Return a builtin_interfaces Duration or Time in s."""
    seconds: float = message.sec + message.nanosec * 1e-9
    return seconds


def check_limits(
    trajectory: Trajectory, limits: JointLimits, *, may_end_moving: bool = False
) -> None:
    """Raise GoalRejectedError INVALID_GOAL that names point, joint, value and limit."""
    found = list(problems(trajectory, limits))
    if not found and not may_end_moving:
        found = list(_end_velocities(trajectory, limits))
    if found:
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, _listed(found))


def untimed(trajectory: Trajectory, limits: JointLimits) -> Trajectory:
    """Return only the positions of a trajectory whose times do not count.

    Its provisional times are slow enough for the velocity limits (shapes as in Trajectory); the
    first one stays, since a point at 0 s is where the arm is, and a later one where it goes to.
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
            yield (
                f'point {last}, {name}: the last velocity, {velocity:.6g} {unit}/s, must be 0 '
                f'(or set allow_nonzero_velocity_at_trajectory_end)'
            )


def check_start(
    trajectory: Trajectory, actual: Array, limits: JointLimits, tolerance: float
) -> None:
    """Raise GoalRejectedError INVALID_GOAL unless the trajectory starts where the arm is.

    A first point at time 0 must be within `tolerance` (rad) of `actual` (shape (n,), rad); a later
    one must be reachable from there in its time.
    """
    offset = np.abs(trajectory.positions[0] - actual)
    time = float(trajectory.times[0])
    found = [
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
    if found:
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, _listed(found))


def _listed(found: Sequence[str]) -> str:
    text = '; '.join(islice(found, MAX_MENTIONED_PROBLEMS))
    rest = len(found) - MAX_MENTIONED_PROBLEMS
    return f'{text}; and {rest} more' if rest > 0 else text
