# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A sequence of motions, straight in joint space, in space or on circles, as one trajectory.

All of it is planned, and refused, before any of it is sent. The arm rests at the end of each.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from math import ceil

import numpy as np

from epson_driver.motion import Array, JointLimits, Trajectory, go
from epson_driver.motion.cartesian import PosePath, arc, line
from epson_driver.robots.cartesian_motion import ToolLimits, cartesian_trajectory
from epson_driver.robots.kinematics import Kinematics

PERIOD_S = 0.05
"""Time between two points of a motion in joint space."""

SHORTEST_MOVE_S = 0.01
"""The time of a motion to where the arm is."""

MOVE_TIME_TOLERANCE = 1e-6
"""By how much, as a share of it, a motion may take longer than its move_time."""

MOVE_SHARES = (0.8, 0.5, 0.3)
"""Shares of its move_time in which a motion of the tool is tried, before it is stretched to it."""


class Kind(IntEnum):
    """Types of control_msgs/msg/MotionPrimitive."""

    LINEAR_JOINT = 0
    LINEAR_CARTESIAN = 50
    CIRCULAR_CARTESIAN = 51


class SequenceError(ValueError):
    """A sequence that cannot be executed; the text says which of its motions, and why."""


@dataclass(frozen=True, eq=False)
class Primitive:
    """One motion.

    target: joint positions, shape (n,), rad (m), or the pose of tool0 in base_link, (4, 4), m.
    via: a place on the circle, shape (3,), m. velocity, acceleration: of each joint, rad/s and
    rad/s² (m/s, m/s²) and at most its limit, or of the tool, m/s and m/s²; None: the joints'
    limits, or those of `ToolLimits`. move_time: s, instead of these two; 0: as fast as they allow.
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
    """A trajectory from rest to rest. ends: shape (k,), s, when each motion ends in it."""

    trajectory: Trajectory
    ends: Array

    def index(self, share: float) -> int:
        """Return which motion is executed after a share, 0 to 1, of the trajectory's time."""
        time = share * self.trajectory.duration
        return min(int(np.searchsorted(self.ends, time, side='right')), len(self.ends) - 1)


def plan_sequence(
    kinematics: Kinematics,
    start: Array,
    primitives: Sequence[Primitive],
    *,
    sampled: bool = True,
    given_up: Callable[[], bool] = lambda: False,
) -> PlannedSequence:
    """Return the way through all motions from joint positions `start`, shape (n,), at rest.

    sampled: also a single motion in joint space as many points, not as its end alone. given_up: is
    asked between the motions, which take up to seconds each. Raises SequenceError.
    """
    parts: list[Trajectory] = []
    at = start
    for index, primitive in enumerate(primitives):
        if given_up():
            raise SequenceError('given up before it began')
        try:
            _check_blend(primitive)
            if primitive.kind is Kind.LINEAR_JOINT:
                alone = not sampled and len(primitives) == 1
                part = _joint_motion(kinematics.model.limits, at, primitive, alone=alone)
            else:
                part = _tool_motion(kinematics, at, primitive)
        except (ValueError, ModuleNotFoundError) as error:
            raise SequenceError(f'motions[{index}], {primitive.kind.name}: {error}') from error
        parts.append(part)
        at = part.positions[-1]
    ends = np.cumsum([part.duration for part in parts])
    return PlannedSequence(_joined(parts), ends)


def _check_blend(primitive: Primitive) -> None:
    """Raise ValueError for what is not there yet: one motion that begins within another."""
    if primitive.blend_radius != 0.0:
        raise ValueError(
            f'blend_radius = {primitive.blend_radius:g} m: must be 0, as motions are not blended '
            'yet: the arm rests at the end of each'
        )


def _joint_motion(
    limits: JointLimits, start: Array, primitive: Primitive, *, alone: bool
) -> Trajectory:
    motion = go(_lowered(limits, primitive), start, primitive.target)
    duration = max(motion.duration, SHORTEST_MOVE_S)
    stretch = _stretch(duration, primitive)
    if alone:
        return Trajectory(limits.names, np.array([duration * stretch]), primitive.target[None, :])
    times = np.linspace(0.0, duration, ceil(duration * stretch / PERIOD_S) + 1)
    states = [motion.at(float(time)) for time in times]
    return Trajectory(
        limits.names,
        times * stretch,
        np.array([position for position, _, _ in states]),
        np.array([velocity for _, velocity, _ in states]) / stretch,
    )


def _lowered(limits: JointLimits, primitive: Primitive) -> JointLimits:
    """Return the limits of a motion in joint space; its move_time makes it slower by itself."""
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
    """Return by what factor a motion is made slower. Raises ValueError for a time too short."""
    if not primitive.move_time:
        return 1.0
    if duration > primitive.move_time * (1.0 + MOVE_TIME_TOLERANCE):
        raise ValueError(
            f'move_time = {primitive.move_time:.4g} s: the joint limits allow no less than '
            f'{duration:.4g} s'
        )
    return primitive.move_time / duration


def _tool_motion(kinematics: Kinematics, start: Array, primitive: Primitive) -> Trajectory:
    first = kinematics.forward(start)
    if primitive.via is None:
        path = line(first, primitive.target)
    else:
        path = arc(first, primitive.via, primitive.target)
    if not primitive.move_time:
        tool = ToolLimits()
        if primitive.velocity is not None:
            tool = replace(tool, speed=primitive.velocity)
        if primitive.acceleration is not None:
            tool = replace(tool, acceleration=primitive.acceleration)
        return cartesian_trajectory(kinematics, start, path, tool)
    for share in MOVE_SHARES:
        tool = _tool_limits_of_time(path, share * primitive.move_time)
        part = cartesian_trajectory(kinematics, start, path, tool)
        if part.duration <= primitive.move_time:
            return _stretched(part, primitive.move_time / part.duration)
    raise ValueError(
        f'move_time = {primitive.move_time:.4g} s: too short for a smooth motion of the tool'
    )


def _tool_limits_of_time(path: PosePath, time: float) -> ToolLimits:
    """Return limits with which the tool takes about so long.

    A third of it each to speed up, at full speed and to slow down.
    """
    speed, turn = 1.5 * path.length / time, 1.5 * path.angle / time
    tiny = 1e-9  # where it does not move, or does not turn
    return ToolLimits(
        speed=max(speed, tiny),
        acceleration=max(3.0 * speed / time, tiny),
        turn_speed=max(turn, tiny),
        turn_acceleration=max(3.0 * turn / time, tiny),
    )


def _stretched(part: Trajectory, factor: float) -> Trajectory:
    velocities = None if part.velocities is None else part.velocities / factor
    return Trajectory(part.joint_names, part.times * factor, part.positions, velocities)


def _joined(parts: Sequence[Trajectory]) -> Trajectory:
    """Return motions, each from where the one before rests, as one trajectory."""
    if len(parts) == 1:
        return parts[0]
    times, begin = [parts[0].times], parts[0].duration
    for part in parts[1:]:
        times.append(begin + part.times[1:])
        begin += part.duration
    rows = [slice(0, None), *[slice(1, None)] * (len(parts) - 1)]
    velocities = [part.velocities for part in parts if part.velocities is not None]
    return Trajectory(
        parts[0].joint_names,
        np.concatenate(times),
        np.vstack([part.positions[row] for part, row in zip(parts, rows, strict=True)]),
        np.vstack([each[row] for each, row in zip(velocities, rows, strict=True)]),
    )
