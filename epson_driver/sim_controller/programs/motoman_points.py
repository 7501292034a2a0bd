# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks of a JOINT_TRAJ_PT_FULL before the arm moves, with Motoman's subcodes.

As MotoROS 1.9 checks it: group, valid fields, time, start position, speed. Stricter than MotoROS:
it warns only of times that do not increase, it sees positions outside the limits when the arm gets
there, and it does not look for numbers that are not finite.
"""

from typing import NamedTuple

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.sim_controller.condition.errors import angles_rejection
from epson_driver.simple_message import JointTrajPtFull, ValidFields
from epson_driver.simple_message.motoman import Invalid

REQUIRED = ValidFields.TIME | ValidFields.POSITION | ValidFields.VELOCITY
"""What every point must carry."""

MAX_TIME_S = 4 * 3600.0
"""Time from which on a point is refused, s: float32 is too coarse for longer trajectories."""

START_TOLERANCE = 5e-4
"""How far point 0 may be from where the arm stands, rad, each joint.

MotoROS compares encoder pulses, and allows 10 to 30 of the about 1000 in a degree, according to
its version. This is 30 pulses, for every joint of every robot.
"""


class InvalidReason(NamedTuple):
    """Why a point is INVALID: the subcode for the client, a sentence for people."""

    subcode: Invalid
    sentence: str


def invalid_form(point: JointTrajPtFull) -> InvalidReason | None:
    """Return the fault of the point by itself, or None. Unused joints count too."""
    if point.robot_id != 0:
        return InvalidReason(
            Invalid.GROUPNO, f'robot_id = {point.robot_id}: there is only group 0'
        )
    missing = REQUIRED & ~point.valid_fields
    if missing:
        names = ', '.join(str(field.name).lower() for field in REQUIRED if field & missing)
        sentence = f'valid_fields = {point.valid_fields}: without {names}'
        return InvalidReason(Invalid.DATA_INSUFFICIENT, sentence)
    if not 0.0 <= point.time < MAX_TIME_S:
        sentence = f'time = {point.time:g} s: must be from 0 to below {MAX_TIME_S:g} s'
        return InvalidReason(Invalid.DATA_TIME, sentence)
    fields = [
        ('positions', point.positions, Invalid.DATA_POSITION),
        ('velocities', point.velocities, Invalid.DATA_SPEED),
    ]
    if point.valid_fields & ValidFields.ACCELERATION:
        fields.append(('accelerations', point.accelerations, Invalid.DATA_ACCEL))
    for name, values, subcode in fields:
        for index, value in enumerate(values):
            if not np.isfinite(value):
                return InvalidReason(subcode, f'{name}[{index}] = {value} is not finite')
    return None


def invalid_start(
    point: JointTrajPtFull, position: Array, limits: JointLimits
) -> InvalidReason | None:
    """Return the fault of point 0 for an arm that stands at `position`, shape (n,), rad."""
    off = np.abs(np.array(point.positions[: len(position)]) - position)
    joint = int(np.argmax(off))
    if off[joint] > START_TOLERANCE:
        unit = limits.units[joint]
        sentence = (
            f'{limits.names[joint]} = {point.positions[joint]:.7g} {unit}, but it stands at '
            f'{position[joint]:.7g} {unit}, more than {START_TOLERANCE:g} {unit} away'
        )
        return InvalidReason(Invalid.DATA_START_POS, sentence)
    return _invalid_speed(point, limits)


def invalid_next(
    point: JointTrajPtFull, before: float, limits: JointLimits
) -> InvalidReason | None:
    """Return the fault of a point that follows one of the time `before`, s, or None."""
    if point.time <= before:
        sentence = f'time = {point.time:g} s: must be after {before:g} s, the point before'
        return InvalidReason(Invalid.DATA_TIME, sentence)
    rejection = angles_rejection(np.array(point.positions[: len(limits.names)]), limits)
    if rejection is not None:
        return InvalidReason(Invalid.DATA_POSITION, rejection.sentence)
    return _invalid_speed(point, limits)


def _invalid_speed(point: JointTrajPtFull, limits: JointLimits) -> InvalidReason | None:
    speeds = np.abs(np.array(point.velocities[: len(limits.names)]))
    # A limit that was rounded to float32 on its way is still allowed.
    above = speeds > np.maximum(limits.velocity, limits.velocity.astype(np.float32))
    if not above.any():
        return None
    joint = int(np.argmax(above))
    unit = limits.units[joint]
    sentence = (
        f'{limits.names[joint]}: {point.velocities[joint]:.7g} {unit}/s is above the limit, '
        f'{limits.velocity[joint]:.7g} {unit}/s'
    )
    return InvalidReason(Invalid.DATA_SPEED, sentence)
