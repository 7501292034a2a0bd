# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A sequence of motions, straight in joint space, in space or on circles, as one trajectory.

All of it is planned before any of it is sent, and refused as a whole. The arm rests at the end of
each motion without a blend radius. A motion with a blend radius blends into the next one, like
the waypoints of paths.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array, JointLimits, Trajectory, go
from epson_driver.motion.point_to_point import SHORTEST_MOVE_S
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.blended_joint_moves import blended_joints
from epson_driver.tool_motion.joint_path import Look, PathError
from epson_driver.tool_motion.path_timing import PERIOD_S, TimedRun, joined
from epson_driver.tool_motion.pose_path import BlendError, PosePath, arc, line, runs
from epson_driver.tool_motion.tool_trajectory import ToolLimits, timed_run

MOVE_TIME_TOLERANCE = 1e-6
"""Relative excess of a motion's duration over its move_time that is accepted."""

MOVE_SHARES = (0.8, 0.5, 0.3)
"""Fractions of the move_time for which a tool motion is planned, before it is stretched to it."""


class Kind(IntEnum):
    """Types of control_msgs/msg/MotionPrimitive."""

    LINEAR_JOINT = 0
    LINEAR_CARTESIAN = 50
    CIRCULAR_CARTESIAN = 51


class SequenceError(ValueError):
    """A sequence cannot be executed, with the motion and the reason as its text."""


@dataclass(frozen=True, eq=False)
class Primitive:
    """One motion.

    target: joint positions, shape (n,), rad (m), or the pose of the tool in base_link,
    (4, 4), m.
    via: a point on the circle, shape (3,), m. velocity, acceleration: for each joint, rad/s and
    rad/s² (m/s, m/s²) and at most its limit, or for the tool, m/s and m/s². None: the limits of
    the joints or of `ToolLimits`. move_time: s, replaces these two. 0: as fast as they allow.
    blend_radius: m.
    """

    kind: Kind
    target: Array
    via: Array | None = None
    velocity: float | None = None
    acceleration: float | None = None
    move_time: float = 0.0
    blend_radius: float = 0.0


@dataclass(frozen=True, eq=False)
class PlannedSequence:
    """A trajectory from rest to rest. ends: end time of each motion in it, shape (k,), s."""

    trajectory: Trajectory
    ends: Array

    def index(self, share: float) -> int:
        """Return the motion executed after a fraction, 0 to 1, of the trajectory's time."""
        time = share * self.trajectory.duration
        return min(int(np.searchsorted(self.ends, time, side='right')), len(self.ends) - 1)


def plan_sequence(
    kinematics: Kinematics,
    start: Array,
    primitives: Sequence[Primitive],
    *,
    sampled: bool = True,
    look: Look = lambda: None,
) -> PlannedSequence:
    """Return a trajectory through all motions from joint positions `start`, shape (n,), at rest.

    sampled: return even a single motion in joint space as many points, not only its end. look:
    called frequently, as motions take up to seconds each to plan. Raises SequenceError.
    """
    groups = list(_groups(primitives))
    runs_of: list[TimedRun] = []
    at = start
    for first, group in groups:
        try:
            look()
            result = _run(kinematics, at, group, look)
        except BlendError as error:
            index = first + error.index
            raise SequenceError(f'{_name(index, primitives[index])}: {error}') from error
        except (ValueError, ModuleNotFoundError) as error:
            last = first + len(group) - 1
            name = _name(first, group[0]) if last == first else f'motions[{first}] to [{last}]'
            raise SequenceError(f'{name}: {error}') from error
        runs_of.append(result)
        at = result.positions[-1]
    names = kinematics.model.limits.names
    if not sampled and len(primitives) == 1 and primitives[0].kind is Kind.LINEAR_JOINT:
        (only,) = runs_of
        end = Trajectory(names, only.ends, primitives[0].target[None, :])
        return PlannedSequence(end, only.ends)
    try:
        return PlannedSequence(*joined(names, runs_of))
    except PathError as error:
        raise SequenceError(str(error)) from error


def _name(index: int, primitive: Primitive) -> str:
    return f'motions[{index}], {primitive.kind.name}'


def _groups(primitives: Sequence[Primitive]) -> Iterator[tuple[int, list[Primitive]]]:
    """Yield the groups of motions that blend into each other, each with its first index.

    Raises SequenceError if motions cannot be blended.
    """
    first = 0
    for index, primitive in enumerate(primitives):
        if primitive.blend_radius == 0.0:
            group = list(primitives[first : index + 1])
            if len(group) > 1:
                _check_group(first, group)
            yield first, group
            first = index + 1
    if first < len(primitives):
        index = len(primitives) - 1
        radius = primitives[index].blend_radius
        raise SequenceError(
            f'{_name(index, primitives[index])}: blend_radius = {radius:g} m: must be 0 '
            'for the last motion'
        )


def _check_group(first: int, group: Sequence[Primitive]) -> None:
    """Raise SequenceError unless the motions can be blended into each other."""
    for index, primitive in enumerate(group, first):
        if primitive.move_time:
            raise SequenceError(
                f'{_name(index, primitive)}: move_time = {primitive.move_time:g} s: must be 0 '
                'for a blended motion, set velocity and acceleration'
            )
    joints = Kind.LINEAR_JOINT
    for index, (one, other) in enumerate(pairwise(group), first):
        if (one.kind is joints) != (other.kind is joints):
            raise SequenceError(
                f'{_name(index, one)}: blend_radius = {one.blend_radius:g} m: must be 0, '
                f'because motions[{index + 1}] is {other.kind.name}: joint and tool motions '
                'cannot be blended'
            )


def _run(kinematics: Kinematics, start: Array, group: Sequence[Primitive], look: Look) -> TimedRun:
    """Return the points of blended motions, or of a single one."""
    radii = [primitive.blend_radius for primitive in group[:-1]]
    if group[0].kind is Kind.LINEAR_JOINT:
        if not radii:
            return _joint_motion(kinematics.model.limits, start, group[0])
        limits = [_lowered(kinematics.model.limits, primitive) for primitive in group]
        targets = [primitive.target for primitive in group]
        return blended_joints(kinematics, start, targets, radii, limits, look)
    segments: list[PosePath] = []
    pose = kinematics.forward(start)
    for index, primitive in enumerate(group):
        try:
            segments.append(_segment(pose, primitive))
        except ValueError as error:
            raise BlendError(index, str(error)) from error
        pose = primitive.target
    (run,) = runs(segments, radii)
    if not group[0].move_time:
        tools = [_tool_limits(primitive) for primitive in group]
        return timed_run(kinematics, start, run, tools, look=look)
    move_time = group[0].move_time
    for fraction in MOVE_SHARES:
        tool = _tool_limits_of_time(segments[0], fraction * move_time)
        result = timed_run(kinematics, start, run, [tool], look=look)
        if result.ends[-1] <= move_time:
            return result.stretched(move_time / float(result.ends[-1]))
    raise ValueError(f'move_time = {move_time:.4g} s: too short for a smooth motion of the tool')


def _segment(begin: Array, primitive: Primitive) -> PosePath:
    if primitive.via is None:
        return line(begin, primitive.target)
    return arc(begin, primitive.via, primitive.target)


def _joint_motion(limits: JointLimits, start: Array, primitive: Primitive) -> TimedRun:
    motion = go(_lowered(limits, primitive), start, primitive.target)
    stretch = _stretch(max(motion.duration, SHORTEST_MOVE_S), primitive)
    points = motion.points(PERIOD_S / stretch)
    assert points.velocities is not None  # noqa: S101 - for the type checker
    result = TimedRun(points.times, points.positions, points.velocities, points.times[-1:])
    return result.stretched(stretch)


def _lowered(limits: JointLimits, primitive: Primitive) -> JointLimits:
    """Return the limits of a motion in joint space, which are unchanged for a move_time."""
    if primitive.move_time:
        return limits
    lowered = limits
    if primitive.velocity is not None:
        lowered = replace(lowered, velocity=np.minimum(limits.velocity, primitive.velocity))
    if primitive.acceleration is not None:
        acceleration = np.minimum(limits.acceleration, primitive.acceleration)
        jerk = limits.jerk * acceleration / limits.acceleration
        lowered = replace(lowered, acceleration=acceleration, jerk=jerk)
    return lowered


def _stretch(duration: float, primitive: Primitive) -> float:
    """Return the slowdown factor of a motion. Raises ValueError if its time is too short."""
    if not primitive.move_time:
        return 1.0
    if duration > primitive.move_time * (1.0 + MOVE_TIME_TOLERANCE):
        raise ValueError(
            f'move_time = {primitive.move_time:.4g} s: the joint limits allow no less than '
            f'{duration:.4g} s'
        )
    return primitive.move_time / duration


def _tool_limits(primitive: Primitive) -> ToolLimits:
    tool = ToolLimits()
    if primitive.velocity is not None:
        tool = replace(tool, speed=primitive.velocity)
    if primitive.acceleration is not None:
        tool = replace(tool, acceleration=primitive.acceleration)
    return tool


def _tool_limits_of_time(path: PosePath, time: float) -> ToolLimits:
    """Return limits with which the tool takes about `time` s.

    It accelerates, moves at full speed and decelerates for a third of the time each.
    """
    speed, turn = 1.5 * path.length / time, 1.5 * path.angle / time
    tiny = 1e-9  # if it does not move, or does not turn
    return ToolLimits(
        speed=max(speed, tiny),
        acceleration=max(3.0 * speed / time, tiny),
        turn_speed=max(turn, tiny),
        turn_acceleration=max(3.0 * turn / time, tiny),
    )
