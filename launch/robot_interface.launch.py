# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver and, on request, a simulated controller, the robot's description, ros2_control."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    IncludeLaunchDescription,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import Node
from launch_ros.substitutions import ExecutableInPackage

from epson_driver.bringup import (
    CONTROLLER,
    DESCRIPTION,
    INTERFACE,
    check_streams,
    client_parameters,
    controller_arguments,
    controllers_parameters,
    effective,
    end_launch,
    first_joint_state,
    launch_arguments,
    misspelled_arguments,
)
from epson_driver.share import share_path

RESPAWN_DELAY_S = 2.0
"""Delay before the client is restarted after its end, s."""


def generate_launch_description():
    """Return the arguments, and the processes that they select."""
    arguments = launch_arguments(
        *INTERFACE, 'interface', 'description', *DESCRIPTION, 'shutdown_on_exit'
    )
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(**argument) for argument in arguments),
            OpaqueFunction(function=processes),
        ]
    )


def processes(context: LaunchContext):
    """Return the simulated controller, if any, and the client. The launch ends with either."""
    values = dict(context.launch_configurations)
    last = values['shutdown_on_exit'] == 'true'
    respawn = values['respawn'] == 'true'
    actions = [LogInfo(msg=f'WARNING: {argument}') for argument in misspelled_arguments(values)]
    parameters = client_parameters(values)
    controlled = values['ros2_control'] == 'true'
    if controlled:
        check_streams(values)
    if values['use_sim_controller'] == 'true':
        controller = ExecutableInPackage(executable='sim_controller', package='epson_driver')
        actions.append(  # not a ROS node: it accepts no --ros-args
            ExecuteProcess(
                cmd=[controller, *controller_arguments(values)],
                output='screen',
                on_exit=end_launch('the simulated controller') if last else None,
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
            respawn=respawn,
            respawn_delay=RESPAWN_DELAY_S,
            on_exit=end_launch('the client') if last and not respawn else None,
        )
    )
    if controlled or values['description'] == 'true':
        names = ('namespace', 'tf_prefix', 'use_sim_time', 'ros2_control', *DESCRIPTION)
        passed = [(name, values[name]) for name in names]
        path = Path(__file__).with_name('robot_description.launch.py')
        actions.append(
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(path)),
                launch_arguments=[*passed, ('robot_model', effective(values)['robot_model'])],
            )
        )
    if controlled:
        actions += ros2_control(values)
    return actions


def ros2_control(values: dict[str, str]):
    """Return the controller manager, which has the description from its topic, and a controller.

    The manager gets no node name: with one, its parameters would not reach its controllers. The
    controller waits for the first joint state: active before, it would hold NaN, and warn.
    """
    file = str(share_path('config', 'ros2_control', 'controllers.yaml'))
    own = controllers_parameters(effective(values)['robot_model'], values['tf_prefix'])
    spawner = Node(
        package='controller_manager',
        executable='spawner',
        namespace=values['namespace'],
        arguments=[CONTROLLER],
        output='screen',
    )
    first = ExecuteProcess(cmd=first_joint_state(values['namespace']), output='log')
    return [
        Node(
            package='controller_manager',
            executable='ros2_control_node',
            namespace=values['namespace'],
            parameters=[file, own | {'use_sim_time': values['use_sim_time'] == 'true'}],
            output='screen',
            on_exit=end_launch('the controller manager'),
        ),
        RegisterEventHandler(
            OnProcessExit(
                target_action=first,
                on_exit=lambda event, _context: [spawner] if event.returncode == 0 else [],
            )
        ),
        first,
    ]
