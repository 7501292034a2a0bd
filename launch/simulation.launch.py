# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A simulated controller and the driver for it; with `panel:=true` the browser panel, too."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from epson_driver.bringup import INTERFACE, launch_arguments

ARGUMENTS = [name for name in INTERFACE if name != 'use_sim_controller']


def generate_launch_description():
    """Return the arguments and robot_interface.launch.py with a simulated controller."""
    passed = [(name, LaunchConfiguration(name)) for name in (*ARGUMENTS, 'interface')]
    interface = Path(__file__).with_name('robot_interface.launch.py')
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(**each)
                for each in launch_arguments(*ARGUMENTS, 'interface', 'panel')
            ),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(interface)),
                launch_arguments=[*passed, ('use_sim_controller', 'true')],
            ),
            Node(
                package='epson_driver',
                executable='panel',
                output='screen',
                condition=IfCondition(LaunchConfiguration('panel')),
            ),
        ]
    )
