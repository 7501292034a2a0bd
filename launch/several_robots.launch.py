# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Several robots on one machine, each with a driver and a description in its namespace.

Values that differ between robots are comma-separated lists. A single value applies to all.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from epson_driver.bringup import EACH, launch_arguments, several_robots

SHARED = ('use_sim_controller', 'sim_motion', 'use_sim_time')


def generate_launch_description():
    """Return the arguments, and the robots that they select."""
    lists = launch_arguments('namespaces', 'robot_ips', *EACH)
    for item in lists:
        item.pop('choices', None)  # they apply to the items
    arguments = [*lists, *launch_arguments(*SHARED, 'panel')]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**argument) for argument in arguments),
            OpaqueFunction(function=robots),
            Node(
                package='epson_driver',
                executable='panel',
                output='screen',
                condition=IfCondition(LaunchConfiguration('panel')),
            ),
        ]
    )


def robots(context: LaunchContext):
    """Return a group for each robot, which scopes its arguments."""
    values = dict(context.launch_configurations)
    shared = {name: values[name] for name in SHARED} | {'description': 'true'}
    path = Path(__file__).with_name('robot_interface.launch.py')
    return [
        GroupAction(
            [
                IncludeLaunchDescription(
                    PythonLaunchDescriptionSource(str(path)),
                    launch_arguments=list((robot | shared).items()),
                )
            ]
        )
        for robot in several_robots(values)
    ]
