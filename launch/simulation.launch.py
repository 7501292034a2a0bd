# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A simulated controller with its driver, and with `panel:=true` the browser panel."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from epson_driver.bringup import DESCRIPTION, INTERFACE, launch_arguments

ARGUMENTS = (
    *(name for name in INTERFACE if name != 'use_sim_controller'),
    'interface',
    'description',
    *DESCRIPTION,
)


def generate_launch_description():
    """Return the arguments, robot_interface.launch.py and, on request, the panel."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(**argument)
                for argument in launch_arguments(*ARGUMENTS, 'panel')
            ),
            OpaqueFunction(function=included),
            Node(
                package='epson_driver',
                executable='panel',
                output='screen',
                condition=IfCondition(LaunchConfiguration('panel')),
            ),
        ]
    )


def included(context: LaunchContext):
    """Return the launch file with a simulated controller."""
    values = context.launch_configurations
    path = Path(__file__).with_name('robot_interface.launch.py')
    return [
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(path)),
            launch_arguments=[
                *((name, values[name]) for name in ARGUMENTS),
                ('use_sim_controller', 'true'),
            ],
        )
    ]
