# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver and, on request, a simulated controller for it."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch_ros.actions import Node
from launch_ros.substitutions import ExecutableInPackage

from epson_driver.bringup import (
    INTERFACE,
    client_parameters,
    controller_arguments,
    launch_arguments,
)


def generate_launch_description():
    """Return the arguments, and the processes that follow from them."""
    arguments = launch_arguments(*INTERFACE, 'interface')
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**each) for each in arguments),
            OpaqueFunction(function=processes),
        ]
    )


def processes(context: LaunchContext):
    """Return the client, preceded by the controller if there is one."""
    values = context.launch_configurations
    actions = []
    if values['use_sim_controller'] == 'true':
        controller = ExecutableInPackage(executable='sim_controller', package='epson_driver')
        actions.append(  # not a ROS node: it accepts no --ros-args
            ExecuteProcess(cmd=[controller, *controller_arguments(values)], output='screen')
        )
    files = [values['params_file']] if values['params_file'] else []
    actions.append(
        Node(
            package='epson_driver',
            executable='client',
            name='epson_driver',  # so that arguments override a params_file for any name
            namespace=values['namespace'],
            parameters=[*files, client_parameters(values)],
            output='screen',
        )
    )
    return actions
