# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smooth goals in front of any driver's FollowJointTrajectory action."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

from epson_driver.bringup import end_launch, launch_arguments

PASSED = ('action', 'limits_file', 'stops')


def generate_launch_description():
    """Return the arguments and the node, whose end ends the launch."""
    arguments = launch_arguments(*PASSED, 'namespace', 'params_file', 'use_sim_time')
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**argument) for argument in arguments),
            OpaqueFunction(function=smooth_goals),
        ]
    )


def smooth_goals(context: LaunchContext):
    """Return the node. Set arguments override params_file."""
    values = context.launch_configurations
    given = {name: values[name] for name in PASSED if values[name]}
    return [
        Node(
            package='epson_driver',
            executable='smooth_goals',
            name='smooth_goals',
            namespace=values['namespace'],
            parameters=[
                *([values['params_file']] if values['params_file'] else []),
                given | {'use_sim_time': values['use_sim_time'] == 'true'},
            ],
            output='screen',
            on_exit=end_launch('smooth_goals'),
        )
    ]
