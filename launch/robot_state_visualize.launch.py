# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver, robot_state_publisher, and RViz, which shows the state of the arm."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource

from epson_driver.bringup import DESCRIPTION, INTERFACE, launch_arguments

RVIZ = ('namespace', 'tf_prefix', 'use_sim_time', 'rviz_config')


def generate_launch_description():
    """Return the arguments and two launch files."""
    more = ('interface', *DESCRIPTION, 'launch_rviz', 'rviz_config')
    arguments = launch_arguments(*INTERFACE, *more)
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**argument) for argument in arguments),
            OpaqueFunction(function=files),
        ]
    )


def files(context: LaunchContext):
    """Return the driver with the description, and RViz on request."""
    values = dict(context.launch_configurations)
    driver = {name: values[name] for name in (*INTERFACE, 'interface', *DESCRIPTION)}
    result = [included('robot_interface', driver | {'description': 'true'})]
    if values['launch_rviz'] == 'true':
        result.append(included('rviz', {name: values[name] for name in RVIZ}))
    return result


def included(name: str, arguments: dict[str, str]):
    """Return a launch file of this folder with these arguments."""
    return IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(Path(__file__).with_name(f'{name}.launch.py'))),
        launch_arguments=list(arguments.items()),
    )
