# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The launch files' arguments as one table: name, default, description, choices."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from epson_driver.inputs import near_name

SWITCH = ('true', 'false')


@dataclass(frozen=True)
class Argument:
    """One argument of launch files. With an empty default, the default of the node applies."""

    name: str
    default: str
    description: str
    choices: tuple[str, ...] = ()


TABLE = (
    Argument(
        'robot_ip',
        '',
        'Address of the robot controller. Empty: as params_file says, or 127.0.0.1.',
    ),
    Argument(
        'robot_model',
        '',
        'Robot model: a file of config/robots, without .yaml, or the path of a .yaml file. '
        'Empty: as params_file says, or c3_a601s.',
    ),
    Argument(
        'controller',
        '',
        'Its kind: a file of config/controllers. Empty: as params_file says, or simulated.',
    ),
    Argument(
        'interface',
        '',
        'How trajectories reach the controller: point by point, or all before the arm moves. '
        "Empty: as params_file says, or the controller's usual way.",
        ('', 'streaming', 'download'),
    ),
    Argument(
        'namespace',
        '',
        'Namespace of the nodes of this robot: its topics, services and its action.',
    ),
    Argument(
        'tf_prefix',
        '',
        'Prefix of the names of all joints and links, such as left_ for left_joint_1.',
    ),
    Argument(
        'motion_port', '', "TCP port of the motion server. Empty: the controller's usual one."
    ),
    Argument('state_port', '', "TCP port of the state server. Empty: the controller's usual one."),
    Argument('io_port', '', "TCP port of the I/O server. Empty: the controller's usual one."),
    Argument(
        'remote_port',
        '',
        'TCP port of Remote Ethernet, which switches the motors; 0: not used. Empty: the '
        "controller's usual one; with use_sim_controller 5000.",
    ),
    Argument(
        'params_file',
        '',
        'YAML file of parameters for the client; arguments that are given override it. Empty: '
        'none.',
    ),
    Argument(
        'use_sim_controller',
        'false',
        'Start a simulated controller as well, on robot_ip, an address of this machine.',
        SWITCH,
    ),
    Argument(
        'sim_motion',
        'smooth',
        'How the simulated controller moves: through the points, or stopping at each.',
        ('smooth', 'ptp'),
    ),
    Argument('use_sim_time', 'false', 'Take the time from /clock, in all nodes.', SWITCH),
    Argument(
        'description',
        'false',
        'Start robot_state_publisher as well: robot_description and tf.',
        SWITCH,
    ),
    Argument(
        'ros2_control',
        'false',
        'Start a controller_manager as well, with a joint_trajectory_controller whose commands '
        'the driver follows as a stream; starts the description, too.',
        SWITCH,
    ),
    Argument(
        'parent',
        '',
        'Frame in which the arm stands, such as world: the transform from there to base_link is '
        'published. Empty: none is.',
    ),
    Argument('origin_xyz', '0 0 0', 'Where base_link is in parent: x y z [m].'),
    Argument('origin_rpy', '0 0 0', 'How base_link is turned in parent: roll pitch yaw [rad].'),
    Argument(
        'shutdown_on_exit',
        'true',
        'End the launch when the client or the simulated controller ends.',
        SWITCH,
    ),
    Argument(
        'respawn',
        'false',
        'Start the client again when it ends, instead of ending the launch; the arm stays '
        'disabled until somebody enables it.',
        SWITCH,
    ),
    Argument('panel', 'false', 'Start the browser panel as well.', SWITCH),
    Argument('launch_rviz', 'true', 'Start RViz.', SWITCH),
    Argument(
        'fix_start_state',
        'false',
        'Let MoveIt plan from the end of its range where a joint that turns is beyond it.',
        SWITCH,
    ),
    Argument('rviz_config', '', 'Display configuration of RViz. Empty: the one of this package.'),
    Argument(
        'action',
        '',
        'Action of the driver behind smooth_goals, such as '
        '/joint_trajectory_controller/follow_joint_trajectory. Empty: as params_file says, or '
        'follow_joint_trajectory.',
    ),
    Argument(
        'limits_file',
        '',
        "MoveIt's joint_limits.yaml, or a robot model. Empty: as params_file says, or the URDF "
        'alone.',
    ),
    Argument(
        'stops',
        '',
        'How a goal is left on its way: by a stop inside the limits, or by the stop of the driver '
        'behind. Empty: as params_file says, or auto.',
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
        'Which robots of params_file this machine drives: their namespaces, separated by commas. '
        'Empty: all of them.',
    ),
)

_ROWS = {row.name: row for row in TABLE}


def launch_arguments(*names: str, **defaults: str) -> list[dict[str, Any]]:
    """Return the keywords of DeclareLaunchArgument, one mapping per name, in this order.

    `defaults` holds the defaults of one launch file, by the name of the argument.
    """
    return [_keywords(_ROWS[name], defaults.get(name)) for name in names]


def misspelled_arguments(given: Iterable[str]) -> list[str]:
    """Return a sentence for each name that is nearly an argument of this package's launch files.

    `given`: the names of all launch configurations. Others may belong to a launch file that
    includes one of ours.
    """
    found = ((name, near_name(name, _ROWS)) for name in given if name not in _ROWS)
    return [
        f'launch argument {name}: there is none of that name; did you mean {near}?'
        for name, near in found
        if near is not None
    ]


def _keywords(row: Argument, default: str | None = None) -> dict[str, Any]:
    keywords: dict[str, Any] = {
        'name': row.name,
        'default_value': row.default if default is None else default,
        'description': row.description,
    }
    if row.choices:  # launch refuses an empty list
        keywords['choices'] = list(row.choices)
    return keywords
