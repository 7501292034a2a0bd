# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a JOINT_TRAJ_PT must be before the arm moves for it."""

import numpy as np

from epson_driver.controller.errors import ErrorNumber, Refusal
from epson_driver.motion import Array, JointLimits
from epson_driver.simple_message import JointTrajPt

SLOWEST = 1e-6
"""Smallest velocity field obeyed: below it a move would take days. 0 means: none given."""

LONGEST = 86_400.0
"""Longest duration field obeyed, s: a day."""


def numbers_refusal(point: JointTrajPt) -> Refusal | None:
    """Return why the point's numbers make no sense, or None. Unused joints count too."""
    for index, angle in enumerate(point.joints):
        if not np.isfinite(angle):
            return _corrupt(f'joints[{index}] = {angle} is not finite')
    for name, value in (('velocity', point.velocity), ('duration', point.duration)):
        if not np.isfinite(value):
            return _corrupt(f'{name} = {value} is not finite')
        if value < 0.0:
            return _corrupt(f'{name} = {value:g} is negative')
    if point.velocity > 1.0:
        return _corrupt(
            f'velocity = {point.velocity:g} is above 1, the fraction of the maximum joint speed'
        )
    if 0.0 < point.velocity < SLOWEST:
        return _corrupt(f'velocity = {point.velocity:g} is below {SLOWEST:g}')
    if point.duration > LONGEST:
        return _corrupt(f'duration = {point.duration:g} s is above {LONGEST:g} s')
    return None


def limits_refusal(point: JointTrajPt, limits: JointLimits) -> Refusal | None:
    """Return which joint of the point is outside its limits, or None.

    A limit that was rounded to float32 on its way is still inside.
    """
    return angles_refusal(np.array(point.joints[: len(limits.names)]), limits)


def angles_refusal(angles: Array, limits: JointLimits) -> Refusal | None:
    """Return which of the angles, shape (n,), rad, is outside its limits, or None."""
    low, high = limits.position_min, limits.position_max
    inside = (angles >= np.minimum(low, low.astype(np.float32))) & (
        angles <= np.maximum(high, high.astype(np.float32))
    )
    if inside.all():
        return None
    joint = int(np.argmin(inside))
    sentence = (
        f'{limits.names[joint]} = {angles[joint]:.7g} rad is outside the limits '
        f'{low[joint]:.7g} … {high[joint]:.7g} rad'
    )
    return Refusal(ErrorNumber.OUT_OF_RANGE, sentence)


def target_of(point: JointTrajPt, limits: JointLimits) -> Array:
    """Return the angles of a point that was not refused, shape (n,), rad, within the limits."""
    return clipped(np.array(point.joints[: len(limits.names)]), limits)


def clipped(angles: Array, limits: JointLimits) -> Array:
    """Return the nearest angles within the limits, shape (n,), rad."""
    nearest: Array = np.clip(angles, limits.position_min, limits.position_max)
    return nearest


def _corrupt(sentence: str) -> Refusal:
    return Refusal(ErrorNumber.CORRUPT_MESSAGE, sentence)
