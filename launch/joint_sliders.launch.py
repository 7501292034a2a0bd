# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A robot model in RViz with a slider per joint, without a controller."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from epson_driver.bringup import DESCRIPTION, launch_arguments

NAMES = ('namespace', 'tf_prefix', 'use_sim_time')


def generate_launch_description():
    """Return the arguments, the description, the sliders and RViz."""
    passed = [(name, LaunchConfiguration(name)) for name in (*NAMES, 'rviz_config')]
    more = (*DESCRIPTION, 'launch_rviz', 'rviz_config')
    arguments = launch_arguments('robot_model', *NAMES, *more)
    path = Path(__file__).with_name('rviz.launch.py')
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**argument) for argument in arguments),
            OpaqueFunction(function=described),
            Node(
                package='joint_state_publisher_gui',
                executable='joint_state_publisher_gui',
                namespace=LaunchConfiguration('namespace'),
            ),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(path)),
                launch_arguments=passed,
                condition=IfCondition(LaunchConfiguration('launch_rviz')),
            ),
        ]
    )


def described(context: LaunchContext):
    """Return the description without ros2_control. `ros2 launch -s` lists the other arguments."""
    values = context.launch_configurations
    path = Path(__file__).with_name('robot_description.launch.py')
    return [
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(path)),
            launch_arguments=[
                (name, values[name]) for name in (*NAMES, 'robot_model', *DESCRIPTION)
            ],
        )
    ]
