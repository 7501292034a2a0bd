# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver smooth_goals`: a node that smooths MoveIt's goals for any driver's action."""

import sys

from rclpy.utilities import remove_ros_args

from epson_driver.cli.arguments import Parser, parsed
from epson_driver.inputs import printable
from epson_driver.node.client_process import run
from epson_driver.node.smooth_goals import DEFAULT_NAME, SmoothGoals

NO_ADDRESS = 'smooth_goals has no address: it forwards goals to a driver that runs'


def main() -> int:
    parser = Parser(
        'smooth_goals',
        'Smooth FollowJointTrajectory goals within the joint limits, and forward them to the '
        "action of another driver. `ros2 param describe` shows the node's parameters.",
        (
            'smooth_goals --ros-args -p limits_file:=joint_limits.yaml \\\n'
            '    -p action:=/joint_trajectory_controller/follow_joint_trajectory',
            'smooth_goals --ros-args -p limits_file:=c4_a601s',
        ),
        '0 stopped by a signal, 1 invalid parameter or internal error, 2 invalid arguments',
    )
    try:
        parsed(parser, remove_ros_args(sys.argv)[1:], refused=NO_ADDRESS)
    except (RuntimeError, ValueError) as error:  # from rcl. ValueError: not valid text
        print(f'{parser.prog}: {printable(error)}', file=sys.stderr)
        return 1
    return run([''], SmoothGoals, DEFAULT_NAME)
