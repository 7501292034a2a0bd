# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The robots of a fleet that one parameters file names, or those of them that are this machine's.

A driver for each, in a process of its own and in its namespace: if one ends, the others go on.
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
from epson_driver.share import share_file

SHARED = ('use_sim_controller', 'sim_motion', 'use_sim_time', 'description')


def generate_launch_description():
    """Return the arguments, and the robots that follow from the file."""
    example = str(share_file('config', 'fleet.yaml'))
    arguments = launch_arguments('params_file', 'robots', *SHARED, params_file=example)
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**each) for each in arguments),
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
