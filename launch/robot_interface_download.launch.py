# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver in download mode: the whole trajectory is sent before the arm moves."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from epson_driver.bringup import INTERFACE, launch_arguments


def generate_launch_description():
    """Return the arguments and robot_interface.launch.py."""
    passed = [(name, LaunchConfiguration(name)) for name in INTERFACE]
    interface = Path(__file__).with_name('robot_interface.launch.py')
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**each) for each in launch_arguments(*INTERFACE)),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(interface)),
                launch_arguments=[*passed, ('interface', 'download')],
            ),
        ]
    )
