# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""EPSON's number for a type of arm, in SPEL+'s RobotType and in GetRobotInfo."""

from epson_driver.robots import RobotModel
from epson_driver.robots.model import SCARA, SIX_AXIS

SIX_AXES, RS_SERIES, N_SERIES = 5, 6, 7
_JOINT_ROBOT, _SCARA = 1, 3


def robot_type(model: RobotModel) -> int:
    """Return the number of a model's type. RS and N series are detected by their geometry."""
    origins = model.chain.origins
    if model.kind == SCARA:
        return RS_SERIES if origins[1, 2] < 0.0 else _SCARA  # arms below each other
    if model.kind == SIX_AXIS:
        return N_SERIES if origins[2, 0] < 0.0 else SIX_AXES  # the upper arm points back at zero
    return _JOINT_ROBOT
