# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From launch arguments to what is started. No ROS here: the launch files import launch."""

from epson_driver.bringup.arguments import launch_arguments, model_argument
from epson_driver.bringup.client import INTERFACE, client_parameters, controller_arguments
from epson_driver.bringup.description import BringupError, robot_description, semantic_description
from epson_driver.bringup.moveit import move_group_parameters, rviz_parameters
from epson_driver.bringup.several import Robot, several_robots

__all__ = [
    'INTERFACE',
    'BringupError',
    'Robot',
    'client_parameters',
    'controller_arguments',
    'launch_arguments',
    'model_argument',
    'move_group_parameters',
    'robot_description',
    'rviz_parameters',
    'semantic_description',
    'several_robots',
]
