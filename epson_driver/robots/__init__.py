# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Robot models as data, from config/robots/."""

from epson_driver.robots.catalogue import robot_models
from epson_driver.robots.chain import Chain, Frame
from epson_driver.robots.model import RobotModel, load_robot_model
from epson_driver.robots.reader import Provenance

__all__ = [
    'Chain',
    'Frame',
    'Provenance',
    'RobotModel',
    'load_robot_model',
    'robot_models',
]
