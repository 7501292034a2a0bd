# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From what a user asks for to a checked trajectory. ValueErrors name field, value and limit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
import numpy.typing as npt

from epson_driver.api.poses import Frames, Pose, Target, Waypoint
from epson_driver.driver.goal.goal_checks import check_limits, untimed
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.inputs import number
from epson_driver.motion import Array, JointLimits, Trajectory, go
from epson_driver.motion.blended_path import BlendError, Run, runs
from epson_driver.motion.cartesian import PosePath, arc, line
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
    """Return how the tool may move. Raises ValueError that names the argument."""
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


@dataclass(frozen=True, eq=False)
class PathPoint:
    """A checked way point: where to go, through what on a circle, and the blend there, m."""

    pose: Target
    via: Target | None = None
    blend: float = 0.0

    def segment(self, before: Array, start: Array) -> PosePath:
        """Return the way there from a pose; the tool began at `start`. Raises ValueError."""
        end = self.pose.seen_from(start)
        if self.via is None:
            return line(before, end)
        return arc(before, self.via.seen_from(start)[:3, 3], end)

    def run(self, start: Array) -> list[Run]:
        """Return the way there from `start`, a pose in base_link. Raises ValueError."""
        return runs([self.segment(start, start)], [])


def path_points(
    points: Sequence[Waypoint | Pose], blend: float, frame: str | None, frames: Frames
) -> list[PathPoint]:
    """Return a user's way points; blend and frame: of those that have none. Raises ValueError."""
    _BLEND.checked(blend, 'blend')
    if isinstance(points, str) or not isinstance(points, Sequence | np.ndarray):
        raise ValueError(f'points = {points!r}: must be a list of poses or way points')
    if not len(points):
        raise ValueError('points: must have at least one')
    last = len(points) - 1
    found = []
    for index, each in enumerate(points):
        name = f'points[{index}]'
        point = each if isinstance(each, Waypoint) else Waypoint(each)
        if point.blend is not None:
            _BLEND.checked(point.blend, f'{name}.blend')
            if index == last and point.blend > 0.0:
                raise ValueError(f'{name}.blend = {point.blend:g} m: nothing follows the last one')
        radius = blend if point.blend is None else point.blend
        its_frame = frame if point.frame is None else point.frame
        pose = frames.target(name, point.pose, its_frame)
        via = None
        if point.via is not None:
            via = frames.point(f'{name}.via', point.via, its_frame, point.pose)
        found.append(PathPoint(pose, via, 0.0 if index == last else float(radius)))
    return found


def path_runs(points: Sequence[PathPoint], start: Array) -> list[Run]:
    """Return the way through points of a tool that is at `start`, a pose in base_link.

    Raises ValueError that names the point: for a blend that does not fit, a circle that is none,
    half a turn, or no way at all.
    """
    segments: list[PosePath] = []
    before = start
    for index, point in enumerate(points):
        try:
            segments.append(point.segment(before, start))
        except ValueError as error:
            raise ValueError(f'points[{index}]: {error}') from error
        before = point.pose.seen_from(start)
    try:
        return runs(segments, [point.blend for point in points[:-1]])
    except BlendError as error:
        raise ValueError(f'points[{error.index}]: {error}') from error


_BLEND = number(0.0, 100.0, 'm')


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
