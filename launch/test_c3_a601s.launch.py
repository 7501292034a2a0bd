# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The C3-A601S in RViz with a slider per joint; no controller is needed."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from epson_driver.bringup import launch_arguments

ARGUMENTS = ('namespace', 'tf_prefix', 'launch_rviz')


def generate_launch_description():
    """Return the arguments and joint_sliders.launch.py."""
    passed = [(name, LaunchConfiguration(name)) for name in ARGUMENTS]
    general = Path(__file__).with_name('joint_sliders.launch.py')
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**each) for each in launch_arguments(*ARGUMENTS)),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(general)),
                launch_arguments=[*passed, ('robot_model', 'c3_a601s')],
            ),
        ]
    )
