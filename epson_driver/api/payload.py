# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the arm carries, from ROS' terms to SPEL+'s."""

import numpy as np
import numpy.typing as npt

from epson_driver.driver.delivery.statements import Load
from epson_driver.motion import Array
from epson_driver.robots import RobotModel


def checked_load(
    model: RobotModel, mass: float, center: npt.ArrayLike, inertia: npt.ArrayLike
) -> Load:
    """Return what Weight and Inertia say of a body, as `aio.Robot.set_payload` takes it.

    Raises ValueError that names the field, its value and the limit.
    """
    weight = model.checked_payload(mass)
    place = _finite('center', center, (3,))
    about = _matrix(inertia)
    if (np.diag(about) < 0.0).any():
        diagonal = np.diag(about).tolist()
        raise ValueError(f'inertia: its diagonal is {diagonal}: must not be negative')
    away = float(np.hypot(*place[:2]))
    return Load(weight, float(about[2, 2]) + weight * away**2, away)


def _matrix(inertia: npt.ArrayLike) -> Array:
    if np.shape(inertia) == (3, 3):
        return _finite('inertia', inertia, (3, 3))
    ixx, ixy, ixz, iyy, iyz, izz = _finite('inertia', inertia, (6,)).tolist()
    return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])


def _finite(field: str, values: npt.ArrayLike, shape: tuple[int, ...]) -> Array:
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{field}: must be numbers ({error})') from error
    if array.shape != shape:
        raise ValueError(f'{field} has shape {array.shape}: must be {shape}')
    if not np.isfinite(array).all():
        raise ValueError(f'{field} = {array.tolist()}: must be finite')
    return array
