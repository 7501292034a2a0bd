# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Several robots on one machine: a driver and a description for each, in its own namespace.

An example to start from: for robots that differ in more than their addresses, add further lists.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from epson_driver.bringup import Robot, launch_arguments, model_argument, several_robots

SHARED = ('controller', 'remote_port', 'use_sim_controller', 'sim_motion')


def generate_launch_description():
    """Return the arguments, and the robots that follow from them."""
    arguments = [
        *launch_arguments('namespaces', 'robot_ips'),
        model_argument(),
        *launch_arguments(*SHARED, 'panel'),
    ]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**each) for each in arguments),
            OpaqueFunction(function=robots),
            Node(
                package='epson_driver',
                executable='panel',
                output='screen',
                condition=IfCondition(LaunchConfiguration('panel')),
            ),
        ]
    )


def robots(context: LaunchContext):
    """Return a group for each robot."""
    values = context.launch_configurations
    return [group(each) for each in several_robots(values['namespaces'], values['robot_ips'])]


def group(robot: Robot):
    """Return the launch files of one robot, in a group that scopes their arguments."""
    own = [
        ('namespace', robot.namespace),
        ('tf_prefix', robot.tf_prefix),
        ('robot_model', LaunchConfiguration('robot_model')),
    ]
    shared = [(name, LaunchConfiguration(name)) for name in SHARED]
    folder = Path(__file__).parent
    return GroupAction(
        [
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(folder / 'robot_interface_streaming.launch.py')),
                launch_arguments=[*own, *shared, ('robot_ip', robot.robot_ip)],
            ),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(folder / 'robot_description.launch.py')),
                launch_arguments=own,
            ),
        ]
    )
