# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver, robot_state_publisher, and RViz, which shows the state of the arm."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from epson_driver.bringup import INTERFACE, launch_arguments, model_argument


def generate_launch_description():
    """Return the arguments and three launch files."""
    others = [name for name in INTERFACE if name != 'robot_model']
    arguments = [model_argument(), *launch_arguments(*others, 'launch_rviz')]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**each) for each in arguments),
            included('robot_interface_streaming', *INTERFACE),
            included('robot_description', 'robot_model', 'namespace', 'tf_prefix'),
            included(
                'rviz',
                'namespace',
                'tf_prefix',
                condition=IfCondition(LaunchConfiguration('launch_rviz')),
            ),
        ]
    )


def included(name: str, *passed: str, condition=None):
    """Return a launch file of this folder with arguments of this one."""
    return IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(Path(__file__).with_name(f'{name}.launch.py'))),
        launch_arguments=[(each, LaunchConfiguration(each)) for each in passed],
        condition=condition,
    )
