# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""From launch arguments to what is started. No ROS here: the launch files import launch."""

from epson_driver.bringup.arguments import (
    launch_arguments,
    misspelled_arguments,
    model_argument,
)
from epson_driver.bringup.client import (
    DEFAULT_MODEL,
    DESCRIPTION,
    INTERFACE,
    client_parameters,
    controller_arguments,
    effective,
)
from epson_driver.bringup.description import (
    BringupError,
    pose_arguments,
    robot_description,
    semantic_description,
)
from epson_driver.bringup.moveit import move_group_parameters, rviz_parameters
from epson_driver.bringup.ros2_control import (
    CONTROLLER,
    check_streams,
    controllers_parameters,
    ros2_control_arguments,
)
from epson_driver.bringup.several import EACH, fleet_robots, several_robots

__all__ = [
    'CONTROLLER',
    'DEFAULT_MODEL',
    'DESCRIPTION',
    'EACH',
    'INTERFACE',
    'BringupError',
    'check_streams',
    'client_parameters',
    'controller_arguments',
    'controllers_parameters',
    'effective',
    'fleet_robots',
    'launch_arguments',
    'misspelled_arguments',
    'model_argument',
    'move_group_parameters',
    'pose_arguments',
    'robot_description',
    'ros2_control_arguments',
    'rviz_parameters',
    'semantic_description',
    'several_robots',
]
