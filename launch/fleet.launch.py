# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The robots of a fleet in a parameters file, or only the robots of this machine.

Each robot has a driver in a separate process and in its namespace. If one ends, the others
continue.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource

from epson_driver.bringup import fleet_robots, launch_arguments
from epson_driver.share import share_path

SHARED = ('use_sim_controller', 'sim_motion', 'use_sim_time', 'description')


def generate_launch_description():
    """Return the arguments, and the robots in the file."""
    example = str(share_path('config', 'fleet.yaml'))
    arguments = launch_arguments('params_file', 'robots', *SHARED, params_file=example)
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**argument) for argument in arguments),
            OpaqueFunction(function=robots),
        ]
    )


def robots(context: LaunchContext):
    """Return a group for each robot, which scopes its arguments."""
    values = dict(context.launch_configurations)
    shared = {name: values[name] for name in SHARED} | {'shutdown_on_exit': 'false'}
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
        for robot in fleet_robots(values)
    ]
