# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver in streaming mode: a trajectory is sent point by point, each acknowledged."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource

from epson_driver.bringup import DESCRIPTION, INTERFACE, launch_arguments

ARGUMENTS = (*INTERFACE, 'description', *DESCRIPTION)


def generate_launch_description():
    """Return the arguments and robot_interface.launch.py."""
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**argument) for argument in launch_arguments(*ARGUMENTS)),
            OpaqueFunction(function=included),
        ]
    )


def included(context: LaunchContext):
    """Return the launch file with a fixed interface. `ros2 launch -s` lists the rest."""
    values = context.launch_configurations
    path = Path(__file__).with_name('robot_interface.launch.py')
    return [
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(path)),
            launch_arguments=[
                *((name, values[name]) for name in ARGUMENTS),
                ('interface', 'streaming'),
            ],
        )
    ]
