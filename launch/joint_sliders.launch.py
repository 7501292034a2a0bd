# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A robot model in RViz with a slider per joint; no controller is needed."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from epson_driver.bringup import launch_arguments, model_argument


def generate_launch_description():
    """Return the arguments, the description, the sliders and RViz."""
    folder = Path(__file__).parent
    names = ('namespace', 'tf_prefix')
    passed = [(name, LaunchConfiguration(name)) for name in names]
    arguments = [model_argument(), *launch_arguments(*names, 'launch_rviz')]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**each) for each in arguments),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(folder / 'robot_description.launch.py')),
                launch_arguments=[*passed, ('robot_model', LaunchConfiguration('robot_model'))],
            ),
            Node(
                package='joint_state_publisher_gui',
                executable='joint_state_publisher_gui',
                namespace=LaunchConfiguration('namespace'),
            ),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(folder / 'rviz.launch.py')),
                launch_arguments=passed,
                condition=IfCondition(LaunchConfiguration('launch_rviz')),
            ),
        ]
    )
