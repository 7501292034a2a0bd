# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver and, on request, a simulated controller for it and the robot's description."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    IncludeLaunchDescription,
    LogInfo,
    OpaqueFunction,
    Shutdown,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import Node
from launch_ros.substitutions import ExecutableInPackage

from epson_driver.bringup import (
    DESCRIPTION,
    INTERFACE,
    client_parameters,
    controller_arguments,
    effective,
    launch_arguments,
    misspelled_arguments,
)


def generate_launch_description():
    """Return the arguments, and the processes that follow from them."""
    arguments = launch_arguments(
        *INTERFACE, 'interface', 'description', *DESCRIPTION, 'shutdown_on_exit'
    )
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**each) for each in arguments),
            OpaqueFunction(function=processes),
        ]
    )


def processes(context: LaunchContext):
    """Return the client, preceded by the controller if there is one; the launch ends with each."""
    values = dict(context.launch_configurations)
    last = values['shutdown_on_exit'] == 'true'
    actions = [LogInfo(msg=f'WARNING: {each}') for each in misspelled_arguments(values)]
    parameters = client_parameters(values)
    if values['use_sim_controller'] == 'true':
        controller = ExecutableInPackage(executable='sim_controller', package='epson_driver')
        actions.append(  # not a ROS node: it accepts no --ros-args
            ExecuteProcess(
                cmd=[controller, *controller_arguments(values)],
                output='screen',
                on_exit=Shutdown(reason='the simulated controller ended') if last else None,
            )
        )
    files = [values['params_file']] if values['params_file'] else []
    actions.append(
        Node(
            package='epson_driver',
            executable='client',
            name='epson_driver',  # so that arguments override a params_file for any name
            namespace=values['namespace'],
            parameters=[*files, parameters],
            output='screen',
            on_exit=Shutdown(reason='the client ended') if last else None,
        )
    )
    if values['description'] == 'true':
        names = ('namespace', 'tf_prefix', 'use_sim_time', *DESCRIPTION)
        passed = [(name, values[name]) for name in names]
        path = Path(__file__).with_name('robot_description.launch.py')
        actions.append(
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(path)),
                launch_arguments=[*passed, ('robot_model', effective(values)['robot_model'])],
            )
        )
    return actions
