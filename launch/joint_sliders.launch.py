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

from epson_driver.bringup import DESCRIPTION, launch_arguments, model_argument


def generate_launch_description():
    """Return the arguments, the description, the sliders and RViz."""
    folder = Path(__file__).parent
    names = ('namespace', 'tf_prefix', 'use_sim_time')
    passed = [(name, LaunchConfiguration(name)) for name in names]
    described = [(name, LaunchConfiguration(name)) for name in ('robot_model', *DESCRIPTION)]
    rest = (*names, *DESCRIPTION, 'launch_rviz', 'rviz_config')
    arguments = [model_argument(), *launch_arguments(*rest)]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**each) for each in arguments),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(folder / 'robot_description.launch.py')),
                launch_arguments=[*passed, *described],
            ),
            Node(
                package='joint_state_publisher_gui',
                executable='joint_state_publisher_gui',
                namespace=LaunchConfiguration('namespace'),
            ),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(folder / 'rviz.launch.py')),
                launch_arguments=[*passed, ('rviz_config', LaunchConfiguration('rviz_config'))],
                condition=IfCondition(LaunchConfiguration('launch_rviz')),
            ),
        ]
    )
