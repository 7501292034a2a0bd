# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The description of the C3-A601S: robot_description and tf."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource

from epson_driver.bringup import DESCRIPTION, launch_arguments

ARGUMENTS = ('namespace', 'tf_prefix', 'use_sim_time', *DESCRIPTION)


def generate_launch_description():
    """Return the arguments and robot_description.launch.py."""
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**argument) for argument in launch_arguments(*ARGUMENTS)),
            OpaqueFunction(function=included),
        ]
    )


def included(context: LaunchContext):
    """Return the launch file with a fixed model. `ros2 launch -s` lists the other arguments."""
    values = context.launch_configurations
    path = Path(__file__).with_name('robot_description.launch.py')
    return [
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(path)),
            launch_arguments=[
                *((name, values[name]) for name in ARGUMENTS),
                ('robot_model', 'c3_a601s'),
            ],
        )
    ]
