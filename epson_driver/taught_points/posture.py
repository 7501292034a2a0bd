# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Hand, elbow, wrist and turns of an arm, as RC+ writes them in .pts files.

Hand 1 is right, 2 left; elbow 1 above, 2 below; wrist 1 as at home with the tool down, 2 flipped.
That was found in public files and programs that write them, not at a controller: where those
disagree or are silent, nothing is said.
"""

from math import atan2, ceil, degrees, hypot, pi, sin

from epson_driver.motion import Array
from epson_driver.robots import RobotModel
from epson_driver.robots.model import SCARA
from epson_driver.robots.opw import KinematicsError, opw_parameters

Posture = dict[str, int]
"""The flags of a point by their keys in a .pts file. Those that are not there are 0."""


def posture(model: RobotModel, joints: Array) -> Posture:
    """Return the flags of an arm at joints, shape (n,). Raises ValueError with why it cannot."""
    low, high = (-pi / 2.0, pi) if model.name.startswith('rs') else (-pi, pi)
    if not low <= joints[0] <= high:
        raise ValueError(
            f'joint 1 is outside {degrees(low):.0f} … {degrees(high):.0f} degrees, where its flag '
            'is not known here'
        )
    if model.kind == SCARA:
        return {'nHand': 1 if joints[1] >= 0.0 else 2, 'nElbow': 1, 'nWrist': 1}
    if model.name.startswith('n'):
        raise ValueError('the flags of an N series are not known here')
    try:
        parameters = opw_parameters(model)
    except KinematicsError as error:
        raise ValueError('the flags of this kind of arm are not known here') from error
    a1, a2, _, _, c2, c3, _ = parameters.lengths.values()
    _, second, third, _, fifth, _ = (
        sign * value - offset
        for sign, value, offset in zip(
            parameters.signs, joints.tolist(), parameters.offsets, strict=True
        )
    )
    turn = third + atan2(a2, c3)
    if a1 + c2 * sin(second) + hypot(a2, c3) * sin(second + turn) < 0.0:
        raise ValueError(
            'the arm reaches over its shoulder, and its flags then are not known here'
        )
    return {
        'nHand': 1,
        'nElbow': 1 if sin(turn) >= 0.0 else 2,
        'nWrist': 1 if fifth >= 0.0 else 2,
        'nJ4Flag': _half_turns(joints[3]),
        'nJ6Flag': _half_turns(joints[5]),
    }


def _half_turns(angle: float) -> int:
    """Return how many half turns an angle, rad, is beyond the first, either way."""
    return max(ceil(abs(angle) / pi) - 1, 0)
