# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks of a JOINT_TRAJ_PT before the arm moves."""

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.sim_controller.condition.errors import (
    Rejection,
    angles_rejection,
    clipped,
    corrupt,
)
from epson_driver.simple_message import (
    BodyError,
    CommType,
    Frame,
    JointTrajPt,
    MessageType,
    ReplyCode,
    decode,
)

MIN_VELOCITY = 1e-6
"""Smallest valid velocity field: below it a move would take days. 0 means not specified."""

MAX_DURATION_S = 86_400.0
"""Longest valid duration field, s: a day."""


POINT_REALS = 12
"""Reals in a JOINT_TRAJ_PT, after the sequence: ten joints, velocity and duration."""


def taken_for_point(frame: Frame, accepts: str, size: int) -> Frame | None:
    """Return the frame that a program reads in the given one, whose points have `size` bytes.

    Return None if it cannot be read. `accepts`: `program.accepts` of a profile.
    """
    least = size - size // POINT_REALS * 2  # without velocity and duration
    if accepts == 'any':
        if len(frame.body) < least:
            return None
        body = frame.body[:size].ljust(size, b'\0')
        point, request = MessageType.JOINT_TRAJ_PT, CommType.SERVICE_REQUEST
        return Frame(point, request, ReplyCode.INVALID, body, frame.byte_order)
    if accepts == 'longer' and frame.msg_type == MessageType.JOINT_TRAJ_PT:
        return frame._replace(body=frame.body[:size])
    return frame


def numbers_rejection(point: JointTrajPt, used: FieldsUsed = FieldsUsed.BOTH) -> Rejection | None:
    """Return why the point's numbers are invalid, or None. Unused joints count too.

    `used`: which of velocity and duration are checked.
    """
    for index, angle in enumerate(point.joints):
        if not np.isfinite(angle):
            return corrupt(f'joints[{index}] = {angle} is not finite')
    velocity = _number_rejection('velocity', point.velocity) if used.velocity else None
    if velocity is not None:
        return velocity
    return _number_rejection('duration', point.duration) if used.duration else None


def _number_rejection(name: str, value: float) -> Rejection | None:
    if not np.isfinite(value):
        return corrupt(f'{name} = {value} is not finite')
    if value < 0.0:
        return corrupt(f'{name} = {value:g} is negative')
    if name == 'duration':
        if value > MAX_DURATION_S:
            return corrupt(f'duration = {value:g} s is above {MAX_DURATION_S:g} s')
    elif value > 1.0:
        return corrupt(f'velocity = {value:g} is above 1, the fraction of the maximum joint speed')
    elif 0.0 < value < MIN_VELOCITY:
        return corrupt(f'velocity = {value:g} is below {MIN_VELOCITY:g}')
    return None


def limits_rejection(point: JointTrajPt, limits: JointLimits) -> Rejection | None:
    """Return the rejection for a joint of the point outside its limits, or None.

    A limit that was rounded to float32 in transit is still inside.
    """
    return angles_rejection(np.array(point.joints[: len(limits.names)]), limits)


def target_of(point: JointTrajPt, limits: JointLimits) -> Array:
    """Return the angles of a point that was not refused, shape (n,), rad, within the limits."""
    return clipped(np.array(point.joints[: len(limits.names)]), limits)


def sequence_of(frame: Frame) -> int:
    """Return the sequence in a JOINT_TRAJ_PT with a wrong header, 0 if the body is wrong too."""
    try:
        request = Frame(frame.msg_type, CommType.SERVICE_REQUEST, 0, frame.body, frame.byte_order)
        message = decode(request).message
    except BodyError:
        return 0
    return message.sequence if isinstance(message, JointTrajPt) else 0
