# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Table of all launch arguments: name, default, description, choices."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from epson_driver.inputs import near_name

SWITCH = ('true', 'false')


@dataclass(frozen=True)
class Argument:
    name: str
    default: str
    description: str
    choices: tuple[str, ...] = ()


TABLE = (
    Argument(
        'robot',
        '',
        'File of `epson_driver connect` with address, profile, model and ports, robot.yaml. Other '
        'arguments override it (empty: none).',
    ),
    Argument(
        'robot_ip',
        '',
        'IP address of the robot controller (empty: from params_file, else 127.0.0.1).',
    ),
    Argument(
        'robot_model',
        '',
        'Robot model: the name of a file in config/robots, without .yaml, or a path '
        '(empty: from params_file, else c3_a601s).',
    ),
    Argument(
        'controller',
        '',
        'Controller profile: the name of a file in config/controllers, or a path '
        '(empty: from params_file, else simulated).',
    ),
    Argument(
        'interface',
        '',
        'Transfer of trajectories: point by point, or all points before the motion '
        "(empty: from params_file, else the profile's).",
        ('', 'streaming', 'download'),
    ),
    Argument(
        'namespace',
        '',
        'Namespace of the nodes, topics, services and actions of this robot.',
    ),
    Argument(
        'tf_prefix',
        '',
        'Prefix of all joint and link names, such as left_ for left_joint_1.',
    ),
    Argument('motion_port', '', "TCP port of the motion server (empty: the profile's)."),
    Argument('state_port', '', "TCP port of the state server (empty: the profile's)."),
    Argument('io_port', '', "TCP port of the I/O server (empty: the profile's)."),
    Argument(
        'remote_port',
        '',
        'TCP port of Remote Ethernet, which switches the motors '
        "(0: not used, empty: the profile's, 5000 with use_sim_controller).",
    ),
    Argument(
        'params_file',
        '',
        'YAML file of parameters for the client. Given arguments override it (empty: none).',
    ),
    Argument(
        'use_sim_controller',
        'false',
        'Start a simulated controller too, at robot_ip, an address of this machine.',
        SWITCH,
    ),
    Argument(
        'sim_motion',
        'smooth',
        'Motion of the simulated controller: through the points, or with a stop at each.',
        ('smooth', 'ptp'),
    ),
    Argument('use_sim_time', 'false', 'Use the time of /clock in all nodes.', SWITCH),
    Argument(
        'description',
        'false',
        'Start robot_state_publisher too: robot_description and tf.',
        SWITCH,
    ),
    Argument(
        'ros2_control',
        'false',
        'Start robot_state_publisher and a controller_manager too, with a '
        'joint_trajectory_controller whose commands the driver follows as a stream.',
        SWITCH,
    ),
    Argument(
        'parent',
        '',
        'Parent frame of base_link, such as world. Its transform is published '
        '(empty: no transform).',
    ),
    Argument('origin_xyz', '0 0 0', 'Position of base_link in parent: x y z [m].'),
    Argument('origin_rpy', '0 0 0', 'Orientation of base_link in parent: roll pitch yaw [rad].'),
    Argument(
        'shutdown_on_exit',
        'true',
        'End the launch when the client or the simulated controller ends.',
        SWITCH,
    ),
    Argument(
        'respawn',
        'false',
        'Restart the client when it ends, instead of ending the launch. The arm stays disabled '
        'until it is enabled explicitly.',
        SWITCH,
    ),
    Argument('panel', 'false', 'Start the browser panel too.', SWITCH),
    Argument('launch_rviz', 'true', 'Start RViz.', SWITCH),
    Argument(
        'fix_start_state',
        'false',
        'Permit MoveIt to plan from the joint limit if a revolute joint is beyond it.',
        SWITCH,
    ),
    Argument('rviz_config', '', 'Display configuration of RViz (empty: from this package).'),
    Argument(
        'action',
        '',
        'Action of the downstream driver, such as '
        '/joint_trajectory_controller/follow_joint_trajectory (empty: from params_file, else '
        'follow_joint_trajectory).',
    ),
    Argument(
        'limits_file',
        '',
        "MoveIt's joint_limits.yaml, or a robot model (empty: from params_file, else the URDF "
        'only).',
    ),
    Argument(
        'stops',
        '',
        'Stop of a running goal: within the limits, or the stop of the downstream driver '
        '(empty: from params_file, else auto).',
        ('', 'auto', 'brake', 'cancel'),
    ),
    Argument('namespaces', 'left,right', 'One namespace per robot, separated by commas.'),
    Argument(
        'robot_ips',
        '127.0.0.1,127.0.0.2',
        'One address per robot, in the order of namespaces, separated by commas.',
    ),
    Argument(
        'robots',
        '',
        'Robots of params_file that this machine drives: their namespaces, separated by commas '
        '(empty: all).',
    ),
)

_ROWS = {row.name: row for row in TABLE}


def launch_arguments(*names: str, **defaults: str) -> list[dict[str, Any]]:
    """Return the keyword arguments of DeclareLaunchArgument for each name.

    `defaults` override the default values of the table.
    """
    return [
        {
            'name': row.name,
            'default_value': defaults.get(row.name, row.default),
            'description': row.description,
        }
        | ({'choices': list(row.choices)} if row.choices else {})  # launch refuses an empty list
        for row in map(_ROWS.__getitem__, names)
    ]


def misspelled_arguments(names: Iterable[str]) -> list[str]:
    """Return a warning for each name that resembles an argument of this package's launch files.

    `names`: names of all launch configurations. Other unknown names are not reported, because they
    may belong to another launch file that includes one of these files.
    """
    result = ((name, near_name(name, _ROWS)) for name in names if name not in _ROWS)
    return [
        f'launch argument {name}: it is unknown, did you mean {near}?'
        for name, near in result
        if near is not None
    ]


def end_launch(name: str) -> Callable[[Any, Any], list[Any]]:
    """Return an `on_exit` handler that ends the launch when a process ends.

    `ros2 launch` then exits with code 1 if the process failed, so that a supervisor restarts it.
    The handler raises an exception for that, because launch has no action that sets an exit code.
    """

    def on_exit(event: Any, context: Any) -> list[Any]:
        if context.is_shutdown:  # Ctrl-C: every process ends
            return []
        if event.returncode:
            raise RuntimeError(f'{name} ended with exit code {event.returncode}')
        from launch.actions import Shutdown

        return [Shutdown(reason=f'{name} ended')]

    return on_exit
