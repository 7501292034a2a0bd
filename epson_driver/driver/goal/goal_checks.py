# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a trajectory must keep before anything of it is sent: limits, its end, where it starts."""

from collections.abc import Iterable, Sequence
from itertools import islice

import numpy as np

from epson_driver.driver.goal.goal import Goal
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.motion import Array, JointLimits, Trajectory, problems

MAX_MENTIONED_PROBLEMS = 5
"""So many violations are spelled out in a goal's error text; the rest is counted."""


def check_goal(goal: Goal, limits: JointLimits) -> None:
    """Raise GoalRejectedError unless a goal is complete, finite and within the limits.

    INVALID_JOINTS for other joints than those of the limits, in another order, or an array of
    another shape; INVALID_GOAL for anything that `check_limits` finds.
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
    check_limits(trajectory, limits, may_end_moving=goal.may_end_moving)


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
