# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""MoveIt for one robot: the driver, its description, move_group and RViz's planning panel."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from epson_driver.bringup import (
    INTERFACE,
    launch_arguments,
    model_argument,
    move_group_parameters,
    robot_description,
    rviz_parameters,
    semantic_description,
)
from epson_driver.share import share_file


def generate_launch_description():
    """Return the arguments, two launch files, and MoveIt's nodes."""
    others = [name for name in INTERFACE if name != 'robot_model']
    arguments = [
        model_argument(),
        *launch_arguments(*others, 'interface', 'launch_rviz', 'rviz_config'),
    ]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**each) for each in arguments),
            included('robot_interface', *INTERFACE, 'interface'),
            included('robot_description', 'robot_model', 'namespace', 'tf_prefix'),
            OpaqueFunction(function=moveit),
        ]
    )


def included(name: str, *passed: str):
    """Return a launch file of this folder with arguments of this one."""
    return IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(Path(__file__).with_name(f'{name}.launch.py'))),
        launch_arguments=[(each, LaunchConfiguration(each)) for each in passed],
    )


def moveit(context: LaunchContext):
    """Return move_group, the pose of the arm in the world, and RViz on request.

    move_group gets no node name: with one, its parameters would not reach the other nodes that it
    creates in the same process.
    """
    values = context.launch_configurations
    robot = (values['robot_model'], values['tf_prefix'])
    descriptions = {
        'robot_description': ParameterValue(robot_description(*robot), value_type=str),
        'robot_description_semantic': ParameterValue(semantic_description(*robot), value_type=str),
    }
    base = values['tf_prefix'] + 'base_link'
    nodes = [
        Node(
            package='moveit_ros_move_group',
            executable='move_group',
            namespace=values['namespace'],
            parameters=[descriptions, move_group_parameters(*robot)],
            output='screen',
        ),
        Node(
            package='tf2_ros',
            executable='static_transform_publisher',
            namespace=values['namespace'],
            arguments=['--frame-id', 'world', '--child-frame-id', base],
        ),
    ]
    if values['launch_rviz'] == 'true':
        config = values['rviz_config'] or str(share_file('config', 'rviz', 'moveit.rviz'))
        nodes.append(
            Node(
                package='rviz2',
                executable='rviz2',
                namespace=values['namespace'],
                arguments=['-d', config, '-f', base],
                parameters=[descriptions, rviz_parameters(*robot)],
            )
        )
    return nodes
