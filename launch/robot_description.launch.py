# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""robot_state_publisher with the URDF of a model: robot_description and tf."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from epson_driver.bringup import launch_arguments, model_argument, robot_description


def generate_launch_description():
    """Return the arguments and the node."""
    arguments = [model_argument(), *launch_arguments('namespace', 'tf_prefix')]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**each) for each in arguments),
            OpaqueFunction(function=publisher),
        ]
    )


def publisher(context: LaunchContext):
    """Return the node for this model and prefix."""
    values = context.launch_configurations
    description = robot_description(values['robot_model'], values['tf_prefix'])
    return [
        Node(
            package='robot_state_publisher',
            executable='robot_state_publisher',
            namespace=values['namespace'],
            parameters=[{'robot_description': ParameterValue(description, value_type=str)}],
        )
    ]
