# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""RViz, showing the robot of a namespace."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

from epson_driver.bringup import launch_arguments
from epson_driver.share import share_path


def generate_launch_description():
    """Return the arguments and the node."""
    arguments = launch_arguments('namespace', 'tf_prefix', 'use_sim_time', 'rviz_config')
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**argument) for argument in arguments),
            OpaqueFunction(function=rviz),
        ]
    )


def rviz(context: LaunchContext):
    """Return RViz. Its topics are relative, so its namespace selects the robot."""
    values = context.launch_configurations
    config = values['rviz_config'] or str(share_path('config', 'rviz', 'robot.rviz'))
    return [
        Node(
            package='rviz2',
            executable='rviz2',
            namespace=values['namespace'],
            arguments=['-d', config, '-f', values['tf_prefix'] + 'base_link'],
            parameters=[{'use_sim_time': values['use_sim_time'] == 'true'}],
        )
    ]
