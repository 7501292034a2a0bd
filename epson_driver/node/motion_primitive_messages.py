# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reads motion primitives from ROS messages. Errors contain the motion, the field and the rule.

The two poses of an arc are its end and a point on it, in the order of ros2_control's
motion_primitives_controllers. The orientation of the second is ignored. Stamps of poses are also
ignored, because their frame does not move.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from control_msgs.action import ExecuteMotionPrimitiveSequence
from control_msgs.msg import MotionArgument, MotionPrimitive, MotionPrimitiveSequence
from geometry_msgs.msg import PoseStamped

from epson_driver.driver.goal.goal import check_limits
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError, Outcome
from epson_driver.inputs import InputError, Rule, number, shown
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.node.remedies import outcome_text
from epson_driver.tool_motion.motion_sequence import Kind, Primitive

MAX_PRIMITIVES = 256
"""The feedback's current_primitive_index is a uint8."""

UNIT_TOLERANCE = 1e-3
"""Maximum deviation of a quaternion's length from 1."""

POSES = {Kind.LINEAR_JOINT: 0, Kind.LINEAR_CARTESIAN: 1, Kind.CIRCULAR_CARTESIAN: 2}

ARGUMENTS: dict[str, Rule] = {
    'velocity': number(1e-5, 1000.0, 'rad/s or m/s'),
    'acceleration': number(1e-4, 100_000.0, 'rad/s² or m/s²'),
    'move_time': number(0.0, 3600.0, 's'),
}
"""Units: joints rad or m, tool m. A nonzero move_time replaces the other arguments."""

_CODES = (ErrorCode.SUCCESSFUL, ErrorCode.INVALID_GOAL, ErrorCode.OLD_HEADER_TIMESTAMP)


def primitives_from_message(
    message: MotionPrimitiveSequence, limits: JointLimits, frame: str
) -> list[Primitive]:
    """Return the motions of a message, with joints in the order of `limits`, poses in `frame`.

    Raises GoalRejectedError INVALID_GOAL.
    """
    count = len(message.motions)
    if not 0 < count <= MAX_PRIMITIVES:
        raise _invalid(f'trajectory has {count} motions: must have 1 to {MAX_PRIMITIVES}')
    return [
        _named(f'motions[{index}]', partial(_primitive, each, limits, frame))
        for index, each in enumerate(message.motions)
    ]


def primitive_result(outcome: Outcome) -> ExecuteMotionPrimitiveSequence.Result:
    """Convert an outcome to an action result, which has fewer codes than FollowJointTrajectory."""
    code = outcome.code if outcome.code in _CODES else ErrorCode.INVALID_GOAL
    text = outcome_text(outcome)
    return ExecuteMotionPrimitiveSequence.Result(error_code=int(code), error_string=text)


def _named(where: str, read: Callable[[], Primitive]) -> Primitive:
    try:
        return read()
    except (InputError, GoalRejectedError) as error:
        raise _invalid(f'{where}: {error}') from error


def _primitive(message: MotionPrimitive, limits: JointLimits, frame: str) -> Primitive:
    try:
        kind = Kind(message.type)
    except ValueError:
        known = ', '.join(f'{each.name} ({each.value})' for each in Kind)
        raise InputError(f'type = {message.type}: must be one of {known}') from None
    if len(message.poses) != POSES[kind]:
        raise InputError(
            f'{kind.name} has {len(message.poses)} poses: must have {POSES[kind]}'
            + (', its end and a place on the way' if kind is Kind.CIRCULAR_CARTESIAN else '')
        )
    arguments = _arguments(message.additional_arguments)
    via = None
    if kind is Kind.LINEAR_JOINT:
        target = _joints(message.joint_positions, limits)
    elif len(message.joint_positions):
        raise InputError(f'joint_positions: must be empty, as {kind.name} goes to a pose')
    else:
        target = _pose('poses[0]', message.poses[0], frame)
        if kind is Kind.CIRCULAR_CARTESIAN:
            via = _place('poses[1]', message.poses[1], frame)
    if not np.isfinite(message.blend_radius) or message.blend_radius < 0.0:
        raise InputError(f'blend_radius = {message.blend_radius}: must be 0 or more, m')
    return Primitive(
        kind,
        target,
        via,
        arguments.get('velocity'),
        arguments.get('acceleration'),
        arguments.get('move_time', 0.0),
        message.blend_radius,
    )


def _arguments(messages: Sequence[MotionArgument]) -> dict[str, float]:
    found: dict[str, float] = {}
    for message in messages:
        name = message.argument_name
        if name not in ARGUMENTS:
            known = ', '.join(ARGUMENTS)
            raise InputError(f'additional_arguments: no {shown(name)}; must be one of {known}')
        if name in found:
            raise InputError(f'additional_arguments has {name} twice')
        found[name] = ARGUMENTS[name].checked(message.argument_value, name)
    return found


def _joints(values: Sequence[float], limits: JointLimits) -> Array:
    if len(values) != len(limits.names):
        raise InputError(
            f'joint_positions has {len(values)} values: must have {len(limits.names)}, for '
            f'{", ".join(limits.names)}'
        )
    positions = limits.settled(np.array(values, dtype=float))
    check_limits(Trajectory(limits.names, np.ones(1), positions[None, :]), limits)
    return positions


def _pose(field: str, message: PoseStamped, frame: str) -> Array:
    """Return a pose as a homogeneous matrix."""
    place = _place(field, message, frame)
    orientation = message.pose.orientation
    x, y, z, w = quaternion = np.array([getattr(orientation, name) for name in 'xyzw'])
    length = float(np.linalg.norm(quaternion))
    if not abs(length - 1.0) <= UNIT_TOLERANCE:
        raise InputError(
            f'{field}: the orientation x, y, z, w = {x:g}, {y:g}, {z:g}, {w:g} must have the '
            f'length 1'
        )
    x, y, z, w = quaternion / length
    pose = np.eye(4)
    pose[:3, :3] = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )
    pose[:3, 3] = place
    return pose


def _place(field: str, message: PoseStamped, frame: str) -> Array:
    if message.header.frame_id not in ('', frame):
        raise InputError(
            f'{field} is in the frame {shown(message.header.frame_id)}: must be in {frame}; '
            'others are not looked up'
        )
    place = np.array([getattr(message.pose.position, name) for name in 'xyz'])
    if not np.all(np.isfinite(place)):
        raise InputError(f'{field}: the position {place.tolist()} must be finite numbers')
    return place


def _invalid(text: str) -> GoalRejectedError:
    return GoalRejectedError(ErrorCode.INVALID_GOAL, text)
