# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""MoveIt for one robot: the driver, its description, move_group and RViz's planning panel."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from epson_driver.bringup import (
    CONTROLLER,
    DESCRIPTION,
    INTERFACE,
    effective,
    end_launch,
    launch_arguments,
    move_group_parameters,
    robot_description,
    rviz_parameters,
    semantic_description,
)
from epson_driver.share import share_path


def generate_launch_description():
    """Return the arguments, two launch files, and MoveIt's nodes."""
    more = ('interface', *DESCRIPTION, 'launch_rviz', 'rviz_config', 'fix_start_state')
    arguments = launch_arguments(*INTERFACE, *more, parent='world')
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**argument) for argument in arguments),
            OpaqueFunction(function=moveit),
        ]
    )


def moveit(context: LaunchContext):
    """Return the driver with the description, move_group, and RViz on request.

    move_group gets no node name: with one, its parameters would not reach the other nodes that it
    creates in the same process.
    """
    values = dict(context.launch_configurations)
    driver = {name: values[name] for name in (*INTERFACE, 'interface', *DESCRIPTION)}
    robot = (effective(values)['robot_model'], values['tf_prefix'])
    time = {'use_sim_time': values['use_sim_time'] == 'true'}
    base = values['tf_prefix'] + 'base_link'
    descriptions = {
        'robot_description': ParameterValue(robot_description(*robot), value_type=str),
        'robot_description_semantic': ParameterValue(
            semantic_description(*robot, values['parent'] or 'world'), value_type=str
        ),
    }
    settings = {'controller': CONTROLLER} if values['ros2_control'] == 'true' else {}
    settings['fix_start_state'] = values['fix_start_state'] == 'true'
    path = Path(__file__).with_name('robot_interface.launch.py')
    nodes = [
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(path)),
            launch_arguments=list((driver | {'description': 'true'}).items()),
        ),
        Node(
            package='moveit_ros_move_group',
            executable='move_group',
            namespace=values['namespace'],
            parameters=[descriptions, move_group_parameters(*robot, **settings), time],
            output='screen',
            on_exit=end_launch('move_group'),
        ),
    ]
    if values['launch_rviz'] == 'true':
        config = values['rviz_config'] or str(share_path('config', 'rviz', 'moveit.rviz'))
        nodes.append(
            Node(
                package='rviz2',
                executable='rviz2',
                namespace=values['namespace'],
                arguments=['-d', config, '-f', base],
                parameters=[descriptions, rviz_parameters(*robot), time],
            )
        )
    return nodes
