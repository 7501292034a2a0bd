# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""robot_state_publisher with the URDF of a model: robot_description and tf."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from epson_driver.bringup import (
    DEFAULT_MODEL,
    DESCRIPTION,
    launch_arguments,
    pose_arguments,
    robot_description,
    ros2_control_arguments,
)


def generate_launch_description():
    """Return the arguments and the nodes."""
    names = ('robot_model', 'namespace', 'tf_prefix', 'use_sim_time', 'ros2_control')
    arguments = launch_arguments(*names, *DESCRIPTION)
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**argument) for argument in arguments),
            OpaqueFunction(function=publishers),
        ]
    )


def publishers(context: LaunchContext):
    """Return the node for a model and prefix, and a static transform if `parent` is set."""
    values = context.launch_configurations
    prefix = values['tf_prefix']
    controlled = values['ros2_control'] == 'true'
    block = ros2_control_arguments(values['namespace']) if controlled else {}
    description = robot_description(values['robot_model'] or DEFAULT_MODEL, prefix, **block)
    time = {'use_sim_time': values['use_sim_time'] == 'true'}
    nodes = [
        Node(
            package='robot_state_publisher',
            executable='robot_state_publisher',
            namespace=values['namespace'],
            parameters=[{'robot_description': ParameterValue(description, value_type=str)}, time],
        )
    ]
    if values['parent']:
        pose = pose_arguments(values['parent'], values['origin_xyz'], values['origin_rpy'], prefix)
        nodes.append(
            Node(
                package='tf2_ros',
                executable='static_transform_publisher',
                namespace=values['namespace'],
                arguments=pose,
                parameters=[time],
            )
        )
    return nodes
