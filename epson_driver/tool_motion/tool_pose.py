# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conversions and checks of poses. Errors name the field and the rule."""

import numpy as np
import numpy.typing as npt

from epson_driver.inputs import shown
from epson_driver.motion import Array
from epson_driver.robots.chain import rotation_about

UNIT_TOLERANCE = 1e-3
"""Maximum difference between the length of a quaternion and 1."""

PLACE = 'numbers; a taught point is robot.points[name]'
"""Description of a pose, or of joint positions, in error texts."""

MAX_TOOL_M = 10.0
"""Maximum distance of a tool from the flange."""


def numbers(field: str, values: object, form: str = 'numbers') -> Array:
    """Return numbers as an array. They may be NaN or infinite.

    Raises ValueError if `values` are not numbers. form: description of valid numbers for the error
    text.
    """
    if isinstance(values, str):
        raise ValueError(f'{field} = {shown(values)}: must be {form}')
    try:
        array = np.array(values)
        if array.dtype.kind not in 'iuf' and array.size:
            raise TypeError(f'these are {array.dtype.name}')
        return array.astype(float)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{field}: must be {form} ({error})') from error


def finite_numbers(field: str, values: npt.ArrayLike, form: str = 'numbers') -> Array:
    array = numbers(field, values, form)
    if not np.all(np.isfinite(array)):
        raise ValueError(f'{field} = {array.tolist()}: must be finite numbers')
    return array


def pose_of_quaternion(field: str, values: Array) -> Array:
    """Return the pose of a position x y z, m, and a quaternion x y z w of length 1, shape (7,)."""
    size = float(np.linalg.norm(values[3:]))
    if abs(size - 1.0) > UNIT_TOLERANCE:
        raise ValueError(
            f'{field}: the quaternion x y z w = {values[3:].tolist()} has length {size:.4g}: must '
            'be 1'
        )
    x, y, z, w = values[3:] / size
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return homogeneous(turn, values[:3])


def check_tool_distance(field: str, pose: Array) -> None:
    """Raise ValueError if a tool, a pose in tool0, is farther than MAX_TOOL_M from the flange."""
    away = float(np.linalg.norm(pose[:3, 3]))
    if away > MAX_TOOL_M:
        raise ValueError(
            f'{field}: the tool is {away:g} m from the flange: at most {MAX_TOOL_M:g} m, and '
            'lengths are in m'
        )


def rotation(turn: Array) -> Array:
    """Return the rotation matrix of a rotation vector, shape (3,), rad."""
    angle = float(np.linalg.norm(turn))
    return rotation_about(turn / angle if angle > 0.0 else turn, angle)


def homogeneous(turned: Array, place: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = turned
    pose[:3, 3] = place
    return pose


def quaternion_pose(pose: Array) -> Array:
    """Return the position x y z, m, and the quaternion x y z w, w ≥ 0, of a pose, shape (7,)."""
    turn = pose[:3, :3]
    # the eigenvector of the largest eigenvalue needs no small divisors. eigh reads the lower half
    xx, yy, zz = np.diag(turn)
    x, y, z = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    products = np.array(
        [
            [xx - yy - zz, 0.0, 0.0, 0.0],
            [turn[0, 1] + turn[1, 0], yy - xx - zz, 0.0, 0.0],
            [turn[0, 2] + turn[2, 0], turn[1, 2] + turn[2, 1], zz - xx - yy, 0.0],
            [x, y, z, xx + yy + zz],
        ]
    )
    quaternion = np.linalg.eigh(products)[1][:, -1]
    return np.concatenate([pose[:3, 3], -quaternion if quaternion[3] < 0.0 else quaternion])
