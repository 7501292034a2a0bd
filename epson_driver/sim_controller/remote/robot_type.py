# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""EPSON's number for a kind of arm, as RobotType of SPEL+ and GetRobotInfo tell it."""

from epson_driver.robots import RobotModel
from epson_driver.robots.model import SCARA, SIX_AXIS

SIX_AXES, RS_SERIES, N_SERIES = 5, 6, 7
_JOINT_ROBOT, _SCARA = 1, 3


def robot_type(model: RobotModel) -> int:
    """Return the number of a model's kind, for arms of RS and N series by how they are built."""
    origins = model.chain.origins
    if model.kind == SCARA:
        return RS_SERIES if origins[1, 2] < 0.0 else _SCARA  # the arms hang below each other
    if model.kind == SIX_AXIS:
        return N_SERIES if origins[2, 0] < 0.0 else SIX_AXES  # the upper arm points back at zero
    return _JOINT_ROBOT
