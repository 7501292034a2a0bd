# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Converts arguments of the motion methods to checked trajectories and paths.

A ValueError names the argument (`field`), its value and the limit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil

import numpy as np
import numpy.typing as npt

from epson_driver.api.poses import Frames, Pose, Target, Waypoint
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.inputs import Rule, number
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.motion.point_to_point import LONGEST_SEGMENT_S, check_fractions
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.pose_path import (
    SHORTEST_PATH,
    BlendError,
    PosePath,
    Run,
    arc,
    distance_from,
    line,
    runs,
)
from epson_driver.tool_motion.tool_pose import PLACE, numbers
from epson_driver.tool_motion.tool_trajectory import JERK_PER_ACCELERATION, ToolLimits

SAMPLE_SPACING_M, MAX_SAMPLES = 1e-3, 2000
"""Spacing of the samples for the accuracy check, m, and their maximum number between stops."""

SAME_PLACE_M, SAME_PLACE_RAD = 1e-4, 1e-3
"""Distance and angle up to which two poses count as the same. Encoder jitter is smaller."""


def joint_rows(field: str, values: Pose, limits: JointLimits, *, rows: bool) -> Array:
    """Return joint values as an array, shape (n,), or (k, n) with `rows`. Raises ValueError."""
    form = 'rows of numbers, all of one length' if rows else PLACE
    array = numbers(field, values, form)
    count = len(limits.names)
    if rows and (array.ndim != 2 or array.shape[1] != count or not len(array)):
        raise ValueError(
            f'{field} has shape {array.shape}: must be (points, {count}), a row of {count} joints '
            'for each point, and at least one'
        )
    if not rows and array.shape != (count,):
        raise ValueError(f'{field} has shape {array.shape}: must be ({count},), one per joint')
    if (wrong := np.argwhere(~np.isfinite(array))).size:
        *point, joint = wrong[0].tolist()
        where = f'{field}[{point[0]}]' if point else field
        value = array[tuple(wrong[0])]
        raise ValueError(f'{where}: {limits.names[joint]} = {value}: must be a finite number')
    return array


def checked(trajectory: Trajectory, limits: JointLimits, field: str) -> Trajectory:
    from epson_driver.driver.goal.goal import check_limits

    try:
        check_limits(trajectory, limits)
    except GoalRejectedError as rejection:
        raise ValueError(f'{field}: {rejection}') from rejection
    return trajectory


def check_speeds(speed: float, acceleration: float) -> None:
    for name, value in (('speed', speed), ('acceleration', acceleration)):
        if isinstance(value, bool) or not isinstance(value, int | float | np.number):
            raise ValueError(f'{name} = {value!r}: must be a number in (0, 1]')
    try:
        check_fractions(float(speed), float(acceleration))
    except ValueError as error:
        text = str(error).replace('accel =', 'acceleration =')
        raise ValueError(f'{text}, a fraction of the joint limits') from error


def tool_limits(
    speed: float,
    acceleration: float,
    turn_speed: float,
    turn_acceleration: float,
    accuracy: float,
    *,
    jerk: float | None,
    slow: bool,
) -> ToolLimits:
    arguments = {
        'speed': speed,
        'acceleration': acceleration,
        'turn_speed': turn_speed,
        'turn_acceleration': turn_acceleration,
        'accuracy': accuracy,
    }
    if jerk is not None:
        arguments['jerk'] = jerk
    limits = {name: _TOOL_RULES[name].checked(value, name) for name, value in arguments.items()}
    ratio = limits.pop('jerk', JERK_PER_ACCELERATION * acceleration) / acceleration
    return ToolLimits(**limits, slow=bool(slow), jerk_ratio=ratio)


_TOOL_RULES = {
    'speed': number(1e-5, 100.0, 'm/s'),
    'acceleration': number(1e-4, 1000.0, 'm/s²'),
    'turn_speed': number(1e-4, 100.0, 'rad/s'),
    'turn_acceleration': number(1e-3, 10000.0, 'rad/s²'),
    'accuracy': number(1e-6, 1.0, 'm'),
    'jerk': number(1e-3, 1e5, 'm/s³'),
}


@dataclass(frozen=True, eq=False)
class PathPoint:
    """A checked waypoint: the pose, a via point for an arc, and the blend distance, m."""

    pose: Target
    via: Target | None = None
    blend: float = 0.0

    def segment(self, before: Array, start: Array) -> PosePath:
        """Return the segment from the pose `before`, shape (4, 4), m, to this point.

        `start`: the pose of the tool at the start of the motion.
        """
        end = self.pose.in_base_link(start)
        if self.via is None:
            return line(before, end)
        return arc(before, self.via.in_base_link(start)[:3, 3], end)

    def run(self, start: Array) -> list[Run]:
        """Return the path from the pose `start` to this point, or [] if both are the same."""
        segment = self.segment(start, start)
        return [] if _is_empty(segment) else runs([segment], [])


def path_points(
    points: Sequence[Waypoint | Pose], blend: float, frame: str | None, frames: Frames
) -> list[PathPoint]:
    """Return the checked points of a path. blend, frame: values for points that set no others."""
    _BLEND.checked(blend, 'blend')
    if isinstance(points, str) or not isinstance(points, Sequence | np.ndarray):
        raise ValueError(f'points = {points!r}: must be a list of poses or Waypoints')
    if not len(points):
        raise ValueError('points: must have at least one point')
    last = len(points) - 1
    result = []
    for index, item in enumerate(points):
        name = f'points[{index}]'
        point = item if isinstance(item, Waypoint) else Waypoint(item)
        if point.blend is not None:
            _BLEND.checked(point.blend, f'{name}.blend')
            if index == last and point.blend > 0.0:
                raise ValueError(f'{name}.blend = {point.blend:g} m: must be 0 for the last point')
        radius = blend if point.blend is None else point.blend
        point_frame = frame if point.frame is None else point.frame
        pose = frames.target(name, point.pose, point_frame)
        via = None
        if point.via is not None:
            via = frames.point(f'{name}.via', point.via, point_frame, point.pose)
        result.append(PathPoint(pose, via, 0.0 if index == last else float(radius)))
    return result


def path_runs(points: Sequence[PathPoint], start: Array) -> list[Run]:
    """Return the path through points, divided into runs. A run is a part between two stops.

    start: the pose of the tool in base_link. The result is [] if all points are at this pose.
    """
    segments: list[PosePath] = []
    before = start
    distinct = _apart(points, start)
    for index, point in distinct:
        try:
            segments.append(point.segment(before, start))
        except ValueError as error:
            raise ValueError(f'points[{index}]: {error}') from error
        before = point.pose.in_base_link(start)
    if len(segments) == 1 and _is_empty(segments[0]):
        return []
    numbers = [index for index, _ in distinct]
    try:
        result = runs(segments, [point.blend for _, point in distinct[:-1]])
    except BlendError as error:
        raise ValueError(f'points[{numbers[error.index]}]: {error}') from error
    return [
        replace(
            run, segments=tuple(tuple(numbers[item] for item in part) for part in run.segments)
        )
        for run in result
    ]


def _apart(points: Sequence[PathPoint], start: Array) -> list[tuple[int, PathPoint]]:
    """Merge consecutive points with the same pose, and return the points with their indices.

    A merged point has the smallest blend and the last index of its points. Points before the first
    motion, which are at the start pose, are dropped. The last point of the path is always kept.
    """
    distinct: list[tuple[int, PathPoint]] = []
    place = start
    for index, point in enumerate(points):
        pose = point.pose.in_base_link(start)
        if point.via is not None or not _same_place(place, pose):
            distinct.append((index, point))
            place = pose
        elif distinct:
            _, before = distinct.pop()
            distinct.append(
                (index, replace(point, via=before.via, blend=min(before.blend, point.blend)))
            )
        elif index == len(points) - 1:
            distinct.append((index, point))
    return distinct


def _same_place(first: Array, second: Array) -> bool:
    away = np.linalg.norm(first[:3, 3] - second[:3, 3])
    turned = np.linalg.norm(first[:3, :3] - second[:3, :3]) / np.sqrt(2.0)  # a small angle, rad
    return bool(away <= SAME_PLACE_M and turned <= SAME_PLACE_RAD)


def deviation(arm: Kinematics, path: Sequence[Run]) -> Callable[[Array], float]:
    """Return a function from joints, shape (n,), to the tool's distance from the path, m."""
    places = []
    for run in path:
        length = sum(part.length for part in run.parts)
        count = min(ceil(length / SAMPLE_SPACING_M) + 2, MAX_SAMPLES)
        distances = np.linspace(0.0, run.seams[-1], count)
        places += [run.pose(distance)[:3, 3] for distance in distances.tolist()]
    samples = np.array(places)
    return lambda joints: distance_from(arm.forward(joints)[:3, 3], samples)


def _is_empty(path: PosePath) -> bool:
    return max(path.length, path.angle) < SHORTEST_PATH


_BLEND = number(0.0, 100.0, 'm')


def checked_factor(value: float) -> float:
    from epson_driver.driver.goal.reference import MIN_FACTOR

    moving = number(MIN_FACTOR, 1.0)
    rule = Rule(
        lambda value: 0.0 if value == 0.0 and value is not False else moving.read(value),
        f'must be 0 (pause), or a number from {MIN_FACTOR:g} to 1 (as planned)',
    )
    return float(rule.checked(value, 'factor'))


def targets(field: str, values: npt.ArrayLike, limits: JointLimits) -> Trajectory:
    """Return joint positions, shape (k, n), as a trajectory with the times 1, 2, … k s."""
    from epson_driver.driver.goal.goal import untimed

    positions = limits.settled(joint_rows(field, values, limits, rows=True))
    times = np.arange(1.0, len(positions) + 1.0)
    trajectory = Trajectory(limits.names, times, positions)
    return checked(untimed(trajectory, limits), limits, field)


def joined(first: Trajectory, then: Trajectory) -> Trajectory:
    assert first.velocities is not None  # noqa: S101 - for the type checker
    assert then.velocities is not None  # noqa: S101 - for the type checker
    return Trajectory(
        first.joint_names,
        np.concatenate([first.times, first.times[-1] + then.times[1:]]),
        np.concatenate([first.positions, then.positions[1:]]),
        np.concatenate([first.velocities, then.velocities[1:]]),
    )


def divided(trajectory: Trajectory, start: Array) -> Trajectory:
    """Return a trajectory whose points are at most LONGEST_SEGMENT_S apart.

    start: joint positions before the first point, shape (n,). Points are added by the same
    interpolation as in the driver.
    """
    from epson_driver.driver.goal.reference import ReferenceTrajectory

    times = trajectory.times.tolist()
    point_times: list[float] = []
    for before, time in zip([0.0, *times], times, strict=False):
        parts = max(ceil((time - before) / LONGEST_SEGMENT_S - 1e-9), 1)
        point_times += np.linspace(before, time, parts + 1)[1:].tolist()
    if len(point_times) == len(times):
        return trajectory
    reference = ReferenceTrajectory(trajectory, start)
    result = [reference.at(time) for time in point_times]
    velocities = None if trajectory.velocities is None else np.array([item[1] for item in result])
    if velocities is not None and trajectory.velocities is not None:
        velocities[-1] = trajectory.velocities[-1]
    return Trajectory(
        trajectory.joint_names,
        np.array(point_times),
        np.array([position for position, _ in result]),
        velocities,
    )


def _permuted(names: tuple[str, ...], order: Sequence[str]) -> tuple[str, ...]:
    if sorted(order) != sorted(names):
        raise ValueError
    return tuple(order)


def planned(
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    velocities: npt.ArrayLike | None,
    joint_names: Sequence[str] | None,
    limits: JointLimits,
) -> Trajectory:
    names = limits.names
    if joint_names is not None:
        read = partial(_permuted, names)
        names = Rule(read, f'must be {", ".join(names)}').checked(joint_names, 'joint_names')
    rows = limits.settled(joint_rows('positions', positions, limits, rows=True))
    values = numbers('times', times)
    if values.shape != (len(rows),):
        raise ValueError(f'times has shape {values.shape}: must be ({len(rows)},), one per point')
    speeds = None
    if velocities is not None:
        speeds = joint_rows('velocities', velocities, limits, rows=True)
        if len(speeds) != len(rows):
            raise ValueError(f'velocities has {len(speeds)} points, positions has {len(rows)}')
    trajectory = Trajectory(names, values, rows, speeds).in_order(limits.names)
    return checked(trajectory, limits, 'trajectory')
