# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From what a user asks for to a checked trajectory. ValueErrors name field, value and limit."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil

import numpy as np
import numpy.typing as npt

from epson_driver.driver.goal.goal_checks import check_limits, untimed
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.inputs import number
from epson_driver.motion import Array, JointLimits, Trajectory, go
from epson_driver.motion.point_to_point import check_fractions
from epson_driver.robots.cartesian_motion import ToolLimits

SAMPLE_PERIOD_S = 0.05
"""Time between two points for controllers that interpolate between positions and velocities."""

SHORTEST_MOVE_S = 0.01
"""The time of a move to where the arm is."""


def joint_rows(field: str, values: npt.ArrayLike, limits: JointLimits, *, rows: bool) -> Array:
    """Return numbers as shape (n,), or (k, n) with `rows`, for n joints. Raises ValueError."""
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        shape = 'rows of numbers, all of one length' if rows else 'numbers'
        raise ValueError(f'{field}: must be {shape} ({error})') from error
    count = len(limits.names)
    if rows and (array.ndim != 2 or array.shape[1] != count or not len(array)):
        raise ValueError(
            f'{field} has shape {array.shape}: must be (points, {count}), a row of {count} joints '
            'for each point, and at least one'
        )
    if not rows and array.shape != (count,):
        raise ValueError(f'{field} has shape {array.shape}: must be ({count},), one per joint')
    return array


def checked(trajectory: Trajectory, limits: JointLimits, field: str) -> Trajectory:
    """Return a trajectory that keeps the limits. Raises ValueError in the driver's words."""
    try:
        check_limits(trajectory, limits)
    except GoalRejectedError as rejection:
        raise ValueError(f'{field}: {rejection}') from rejection
    return trajectory


def scaled_limits(limits: JointLimits, speed: float, acceleration: float) -> JointLimits:
    """Return limits with shares, (0, 1], of velocity and of acceleration and jerk."""
    return replace(
        limits,
        velocity=limits.velocity * speed,
        acceleration=limits.acceleration * acceleration,
        jerk=limits.jerk * acceleration,
    )


def check_shares(speed: float, acceleration: float) -> None:
    """Raise ValueError unless both are shares of the joint limits, (0, 1]."""
    for name, value in (('speed', speed), ('acceleration', acceleration)):
        if not isinstance(value, int | float | np.number):
            raise ValueError(f'{name} = {value!r}: must be a number in (0, 1]')
    try:
        check_fractions(float(speed), float(acceleration))
    except ValueError as error:
        text = str(error).replace('accel =', 'acceleration =')
        raise ValueError(f'{text}, a share of the joint limits') from error


def tool_limits(
    speed: float,
    acceleration: float,
    turn_speed: float,
    turn_acceleration: float,
    accuracy: float,
    *,
    slow: bool,
) -> ToolLimits:
    """Return how the flange may move. Raises ValueError that names the argument."""
    given = {
        'speed': speed,
        'acceleration': acceleration,
        'turn_speed': turn_speed,
        'turn_acceleration': turn_acceleration,
        'accuracy': accuracy,
    }
    checked_values = {
        name: _TOOL_RULES[name].checked(value, name) for name, value in given.items()
    }
    return ToolLimits(**checked_values, slow=bool(slow))


_TOOL_RULES = {
    'speed': number(1e-5, 100.0, 'm/s'),
    'acceleration': number(1e-4, 1000.0, 'm/s²'),
    'turn_speed': number(1e-4, 100.0, 'rad/s'),
    'turn_acceleration': number(1e-3, 10000.0, 'rad/s²'),
    'accuracy': number(1e-6, 1.0, 'm'),
}


def checked_point(field: str, values: npt.ArrayLike) -> Array:
    """Return three finite numbers, shape (3,). Raises ValueError."""
    return _finite(field, values, (3,))


def checked_pose(field: str, values: npt.ArrayLike) -> Array:
    """Return a homogeneous matrix, shape (4, 4), whose place is in m. Raises ValueError."""
    pose = _finite(field, values, (4, 4))
    turn = pose[:3, :3]
    if (
        np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6
        or np.linalg.det(turn) < 0.0
        or np.abs(pose[3] - (0.0, 0.0, 0.0, 1.0)).max() > 1e-9
    ):
        raise ValueError(f'{field}: must be a rotation and a place, with 0 0 0 1 in its last row')
    return pose


def _finite(field: str, values: npt.ArrayLike, shape: tuple[int, ...]) -> Array:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{field}: must be numbers of shape {shape} ({error})') from error
    if array.shape != shape:
        raise ValueError(f'{field} has shape {array.shape}: must be {shape}')
    if not np.all(np.isfinite(array)):
        raise ValueError(f'{field} = {array.tolist()}: must be finite numbers')
    return array


def targets(field: str, values: npt.ArrayLike, limits: JointLimits) -> Trajectory:
    """Return way points, shape (k, n), with times that do not count. Raises ValueError."""
    positions = joint_rows(field, values, limits, rows=True)
    times = np.arange(1.0, len(positions) + 1.0)
    trajectory = Trajectory(limits.names, times, positions)
    if not np.all(np.isfinite(positions)):
        return checked(trajectory, limits, field)  # which says which is not
    return checked(untimed(trajectory, limits), limits, field)


def straight(
    start: Array,
    target: Array,
    limits: JointLimits,
    speed: float,
    acceleration: float,
    *,
    sampled: bool,
) -> Trajectory:
    """Return the fastest move from rest to rest, straight in joint space, at shares of the limits.

    `sampled`: as many points with velocities; otherwise its end alone, with the time it takes.
    """
    motion = go(limits, start, target, speed, acceleration)
    duration = max(motion.duration, SHORTEST_MOVE_S)
    if not sampled:
        return Trajectory(limits.names, np.array([duration]), target[None, :])
    times = np.linspace(0.0, duration, ceil(duration / SAMPLE_PERIOD_S) + 1)
    states = [motion.at(float(time)) for time in times]
    return Trajectory(
        limits.names,
        times,
        np.array([position for position, _, _ in states]),
        np.array([velocity for _, velocity, _ in states]),
    )


def planned(
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    velocities: npt.ArrayLike | None,
    joint_names: Sequence[str] | None,
    limits: JointLimits,
) -> Trajectory:
    """Return a user's trajectory in the controller's joint order. Raises ValueError."""
    names = limits.names if joint_names is None else tuple(joint_names)
    if sorted(names) != sorted(limits.names):
        raise ValueError(f'joint_names = {list(names)}: must be {", ".join(limits.names)}')
    rows = joint_rows('positions', positions, limits, rows=True)
    try:
        moments = np.array(times, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f'times: must be numbers ({error})') from error
    if moments.shape != (len(rows),):
        raise ValueError(f'times has shape {moments.shape}: must be ({len(rows)},), one per point')
    speeds = None
    if velocities is not None:
        speeds = joint_rows('velocities', velocities, limits, rows=True)
        if len(speeds) != len(rows):
            raise ValueError(f'velocities has {len(speeds)} points, positions has {len(rows)}')
    trajectory = Trajectory(names, moments, rows, speeds).in_order(limits.names)
    return checked(trajectory, limits, 'trajectory')
