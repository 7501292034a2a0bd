# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`ros2 run epson_driver client`: the ROS 2 node, or several of them in one process."""

import argparse
import sys
from collections.abc import Sequence

from rclpy.utilities import remove_ros_args

from epson_driver.inputs import printable
from epson_driver.node.client_process import run


def main() -> int:
    """Run until SIGINT or SIGTERM and return the exit code of `run`."""
    try:
        namespaces = _namespaces(remove_ros_args(sys.argv)[1:])
    except (RuntimeError, ValueError) as error:  # from rcl. ValueError: not valid text
        print(f'epson_driver client: {printable(error)}', file=sys.stderr)
        return 1
    return run(namespaces)


def _namespaces(arguments: Sequence[str]) -> list[str]:
    parser = argparse.ArgumentParser(
        prog='epson_driver client',
        description='The ROS 2 node that drives a controller, or several in one process: one for '
        'each --namespace.',
        epilog='ROS arguments as everywhere: --ros-args -p robot_ip:=192.168.0.1; for several '
        'robots --ros-args --params-file FILE, with /NAME/epson_driver: ros__parameters: …',
    )
    parser.add_argument(
        '--namespace',
        metavar='NAME',
        action='append',
        help="a robot's namespace; once for each robot (none: one robot, where __ns says)",
    )
    return parser.parse_args(arguments).namespace or ['']
