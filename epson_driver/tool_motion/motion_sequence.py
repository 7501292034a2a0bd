# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A sequence of joint moves, lines and arcs, planned as one trajectory.

The whole sequence is planned before execution, or refused. A motion with a blend radius blends
into the next one. The arm rests at the end of a motion without a blend radius.
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
from epson_driver.tool_motion.joint_path import Checkpoint, PathError
from epson_driver.tool_motion.path_timing import PERIOD_S, TimedRun, joined
from epson_driver.tool_motion.pose_path import BlendError, PosePath, arc, line, runs
from epson_driver.tool_motion.tool_trajectory import ToolLimits, timed_run

MOVE_TIME_TOLERANCE = 1e-6
"""Fraction of its move_time by which a motion's minimum duration may exceed the move_time."""

MOVE_FRACTIONS = (0.8, 0.5, 0.3)
"""Fractions of the move_time for which a tool motion is planned, in this order. The first planned
motion that is no longer than the move_time is slowed down to the move_time."""


class Kind(IntEnum):
    """Types of control_msgs/msg/MotionPrimitive."""

    LINEAR_JOINT = 0
    LINEAR_CARTESIAN = 50
    CIRCULAR_CARTESIAN = 51


class SequenceError(ValueError):
    """A sequence that cannot be executed. The text names the motion and the reason."""


@dataclass(frozen=True, eq=False)
class Primitive:
    """One motion of a sequence."""

    kind: Kind
    target: Array
    """Joint positions, shape (n,), rad (m), or the pose of the tool in base_link, (4, 4), m."""
    via: Array | None = None
    """A point on the arc, shape (3,), m. None: the motion is not an arc."""
    velocity: float | None = None
    """Maximum velocity of each joint, rad/s (m/s), or of the tool, m/s. None: default limit."""
    acceleration: float | None = None
    """Maximum acceleration of each joint, rad/s² (m/s²), or of the tool, m/s². None: default."""
    move_time: float = 0.0
    """Duration that replaces velocity and acceleration, s. 0: not set."""
    blend_radius: float = 0.0
    """Radius of the blend into the next motion, m. 0: the arm rests at the end."""


@dataclass(frozen=True, eq=False)
class PlannedSequence:
    """A trajectory from rest to rest, with k motions. ends: end time of each motion, (k,), s."""

    trajectory: Trajectory
    ends: Array

    def index(self, fraction: float) -> int:
        """Return the index of the motion that is executed at a fraction of the duration."""
        time = fraction * self.trajectory.duration
        return min(int(np.searchsorted(self.ends, time, side='right')), len(self.ends) - 1)


def plan_sequence(
    kinematics: Kinematics,
    start: Array,
    primitives: Sequence[Primitive],
    *,
    sampled: bool = True,
    checkpoint: Checkpoint = lambda: None,
) -> PlannedSequence:
    """Return the trajectory of all motions, from rest at the joint positions `start`, shape (n,).

    sampled: if False, only the end point of a single joint move is returned. checkpoint: called
    often, because a motion may take seconds to plan. It may raise to cancel.

    Raises SequenceError if a motion cannot be executed.
    """
    groups = list(_groups(primitives))
    timed_runs: list[TimedRun] = []
    position = start
    for first, group in groups:
        try:
            checkpoint()
            result = _run(kinematics, position, group, checkpoint)
        except BlendError as error:
            index = first + error.index
            raise SequenceError(f'{_name(index, primitives[index])}: {error}') from error
        except (ValueError, ModuleNotFoundError) as error:
            last = first + len(group) - 1
            name = _name(first, group[0]) if last == first else f'motions[{first}] to [{last}]'
            raise SequenceError(f'{name}: {error}') from error
        timed_runs.append(result)
        position = result.positions[-1]
    names = kinematics.model.limits.names
    if not sampled and len(primitives) == 1 and primitives[0].kind is Kind.LINEAR_JOINT:
        (only,) = timed_runs
        end = Trajectory(names, only.ends, primitives[0].target[None, :])
        return PlannedSequence(end, only.ends)
    try:
        return PlannedSequence(*joined(names, timed_runs))
    except PathError as error:
        raise SequenceError(str(error)) from error


def _name(index: int, primitive: Primitive) -> str:
    return f'motions[{index}], {primitive.kind.name}'


def _groups(primitives: Sequence[Primitive]) -> Iterator[tuple[int, list[Primitive]]]:
    """Yield each group of motions blended together, with the index of its first motion."""
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
    for index, primitive in enumerate(group, first):
        if primitive.move_time:
            raise SequenceError(
                f'{_name(index, primitive)}: move_time = {primitive.move_time:g} s: must be 0 '
                'for a blended motion, set velocity and acceleration'
            )
    joints = Kind.LINEAR_JOINT
    for index, (current, following) in enumerate(pairwise(group), first):
        if (current.kind is joints) != (following.kind is joints):
            raise SequenceError(
                f'{_name(index, current)}: blend_radius = {current.blend_radius:g} m: must be 0, '
                f'because motions[{index + 1}] is {following.kind.name}: joint and tool motions '
                'cannot be blended'
            )


def _run(
    kinematics: Kinematics, start: Array, group: Sequence[Primitive], checkpoint: Checkpoint
) -> TimedRun:
    radii = [primitive.blend_radius for primitive in group[:-1]]
    if group[0].kind is Kind.LINEAR_JOINT:
        if not radii:
            return _joint_motion(kinematics.model.limits, start, group[0])
        limits = [_lowered(kinematics.model.limits, primitive) for primitive in group]
        targets = [primitive.target for primitive in group]
        return blended_joints(kinematics, start, targets, radii, limits, checkpoint)
    segments: list[PosePath] = []
    pose = kinematics.forward(start)
    for index, primitive in enumerate(group):
        try:
            via, end = primitive.via, primitive.target
            segments.append(line(pose, end) if via is None else arc(pose, via, end))
        except ValueError as error:
            raise BlendError(index, str(error)) from error
        pose = primitive.target
    (run,) = runs(segments, radii)
    if not group[0].move_time:
        tools = [_tool_limits(primitive) for primitive in group]
        return timed_run(kinematics, start, run, tools, checkpoint=checkpoint)
    move_time = group[0].move_time
    for fraction in MOVE_FRACTIONS:
        tool = _tool_limits_of_time(segments[0], fraction * move_time)
        result = timed_run(kinematics, start, run, [tool], checkpoint=checkpoint)
        if result.ends[-1] <= move_time:
            return result.stretched(move_time / float(result.ends[-1]))
    raise ValueError(f'move_time = {move_time:.4g} s: too short for a smooth motion of the tool')


def _joint_motion(limits: JointLimits, start: Array, primitive: Primitive) -> TimedRun:
    motion = go(_lowered(limits, primitive), start, primitive.target)
    stretch = _stretch(max(motion.duration, SHORTEST_MOVE_S), primitive)
    points = motion.points(PERIOD_S / stretch)
    assert points.velocities is not None  # noqa: S101 - for the type checker
    result = TimedRun(points.times, points.positions, points.velocities, points.times[-1:])
    return result.stretched(stretch)


def _lowered(limits: JointLimits, primitive: Primitive) -> JointLimits:
    """Return the joint limits, reduced to the velocity and acceleration of a joint move."""
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
    """Return the slowdown factor of a motion. Raises ValueError if its move_time is too short."""
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
    """Return limits with which the tool takes about `time` s, a third of it for each ramp."""
    speed, turn = 1.5 * path.length / time, 1.5 * path.angle / time
    tiny = 1e-9  # for a motion without distance or without turn
    return ToolLimits(
        speed=max(speed, tiny),
        acceleration=max(3.0 * speed / time, tiny),
        turn_speed=max(turn, tiny),
        turn_acceleration=max(3.0 * turn / time, tiny),
    )
