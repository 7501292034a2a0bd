# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the arm carries, from ROS' terms to SPEL+'s."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from epson_driver.robots import RobotModel
from epson_driver.tool_motion.tool_pose import finite_numbers

if TYPE_CHECKING:  # the driver is loaded with the first Robot
    from epson_driver.driver.delivery.statements import Load


def checked_load(
    model: RobotModel, mass: float, center: npt.ArrayLike, inertia: npt.ArrayLike
) -> 'Load':
    """Return what Weight and Inertia say of a body, as `aio.Robot.set_payload` takes it.

    Raises ValueError that names the field, its value and the limit.
    """
    from epson_driver.driver.delivery.statements import Load

    weight = model.checked_payload(mass, 'mass')
    place = finite_numbers('center', center)
    if place.shape != (3,):
        raise ValueError(f'center has shape {place.shape}: must be (3,), x y z in m')
    about = finite_numbers('inertia', inertia)
    if about.shape == (6,):
        ixx, ixy, ixz, iyy, iyz, izz = about.tolist()
        about = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    if about.shape != (3, 3):
        raise ValueError(
            f'inertia has shape {about.shape}: must be (6,), ixx ixy ixz iyy iyz izz, or (3, 3)'
        )
    if (np.diag(about) < 0.0).any():
        diagonal = np.diag(about).tolist()
        raise ValueError(f'inertia: its diagonal is {diagonal}: must not be negative')
    away = float(np.hypot(*place[:2]))
    return Load(weight, float(about[2, 2]) + weight * away**2, away)
