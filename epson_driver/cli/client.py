# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver client`: the driver's ROS 2 node, or several of them in one process."""

import json
import sys
from collections.abc import Sequence

from rclpy.utilities import remove_ros_args

from epson_driver.cli.arguments import Parser
from epson_driver.inputs import printable
from epson_driver.node.client_process import run
from epson_driver.setup.robot_file import robot_settings
from epson_driver.setup.table import ROWS


def main() -> int:
    try:
        if sys.argv[1:] and sys.argv[1].endswith('.yaml'):
            robot_settings(sys.argv[1])
            sys.argv[1:2] = ['--ros-args', '--params-file', sys.argv[1], '--']
        namespaces = _namespaces(remove_ros_args(sys.argv)[1:])
    except (RuntimeError, ValueError) as error:  # from rcl. ValueError: not valid text
        print(f'epson_driver client: {printable(error)}', file=sys.stderr)
        return 1
    return run(namespaces)


def _namespaces(arguments: Sequence[str]) -> list[str]:
    parser = Parser(
        'client',
        'Run the ROS 2 node that drives a controller, or one node per --namespace.',
        (
            'client robot.yaml',
            'client --ros-args -p robot_ip:=192.168.0.1 -p controller:=spel',
            'client --namespace left --namespace right --ros-args --params-file FILE',
        ),
        '0 stopped by a signal, 1 invalid parameter or internal error, 2 invalid arguments',
        '\n'.join(
            (
                '\nparameters (-p NAME:=VALUE) and their defaults:',
                *(f'  {row.name:40} {json.dumps(row.default)}' for row in ROWS.values()),
                '',
                '`ros2 param describe /epson_driver NAME` describes one while the node runs.',
            )
        ),
    )
    parser.option(
        '--namespace NAME',
        "namespace of a robot (repeatable, default: the node's own)",
        action='append',
    )
    return parser.parse_args(arguments).namespace or ['']
