# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conversion of launch arguments to node parameters, without importing ROS."""

from epson_driver.bringup.arguments import (
    end_launch,
    launch_arguments,
    misspelled_arguments,
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
from epson_driver.bringup.moveit import (
    move_group_parameters,
    rviz_parameters,
    servo_parameters,
    write_moveit_package,
)
from epson_driver.bringup.params_file import EACH, fleet_robots, several_robots
from epson_driver.bringup.ros2_control import (
    CONTROLLER,
    check_streams,
    controllers_parameters,
    first_joint_state,
    ros2_control_arguments,
)

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
    'end_launch',
    'first_joint_state',
    'fleet_robots',
    'launch_arguments',
    'misspelled_arguments',
    'move_group_parameters',
    'pose_arguments',
    'robot_description',
    'ros2_control_arguments',
    'rviz_parameters',
    'semantic_description',
    'servo_parameters',
    'several_robots',
    'write_moveit_package',
]
