# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Robot models as data, from config/robots/."""

from epson_driver.robots.model import RobotModel, RobotModelError, load_robot_model

__all__ = ['RobotModel', 'RobotModelError', 'load_robot_model']
