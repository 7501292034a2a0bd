# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver jog`: moves single joints by keys, over the driver's `~/joint_jog`."""

import argparse
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable

import rclpy
from control_msgs.msg import JointJog
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState

from epson_driver.cli.arguments import argument
from epson_driver.cli.jog_keys import BACKWARD, FORWARD, MAX_SPEED, MIN_SPEED, JogKeys
from epson_driver.inputs import number, printable

PERIOD_S = 0.02
"""Time between two messages while a key is held, s."""

WAIT_S = 10.0
"""How long to wait for the driver, s."""

SPEED = number(MIN_SPEED, MAX_SPEED, 'rad/s')
UNIT = 'rad/s (m/s of a joint that slides)'


def main() -> int:
    """Jog until x, Escape or Ctrl-C. Returns 1 if there is no terminal or no driver."""
    try:
        args = _arguments(remove_ros_args(sys.argv)[1:])
        if not sys.stdin.isatty():
            print('epson_driver jog: needs a terminal for its keys', file=sys.stderr)
            return 1
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node('jog')
    except (RuntimeError, ValueError) as error:
        print(f'epson_driver jog: {printable(error)}', file=sys.stderr)
        return 1
    try:
        publisher = node.create_publisher(JointJog, f'{args.node}/joint_jog', 1)
        names = _joint_names(node)
        if names is None or not publisher.get_subscription_count():
            print(
                f'epson_driver jog: no joint_states and {args.node}/joint_jog within '
                f'{WAIT_S:g} s: start the client, and give its name with --node',
                file=sys.stderr,
            )
            return 1
        _say(names, args.speed)
        before = termios.tcgetattr(sys.stdin)
        try:
            tty.setcbreak(sys.stdin)
            _jog(names, args.speed, publisher.publish)
        finally:
            publisher.publish(JointJog(joint_names=names, velocities=[0.0] * len(names)))
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
    finally:
        node.destroy_node()
        rclpy.shutdown()
    return 0


def _jog(names: list[str], speed: float, publish: Callable[[JointJog], None]) -> None:
    """Publish a velocity while a key is held, and all zero once when it is released."""
    keys = JogKeys(len(names), speed)
    moved = False
    while not keys.ended:
        wait = PERIOD_S if moved else None
        ready, _, _ = select.select([sys.stdin], [], [], wait)
        now = time.monotonic()
        if ready:
            for key in os.read(sys.stdin.fileno(), 64).decode(errors='replace') or ['']:
                keys.press(key, now)
        velocity = keys.velocity(now)
        if velocity is not None:
            joint, value = velocity
            publish(JointJog(joint_names=[names[joint]], velocities=[value], duration=PERIOD_S))
        elif moved:
            publish(JointJog(joint_names=names, velocities=[0.0] * len(names)))
        if ready and velocity is None and not keys.ended:
            print(f'{keys.speed:.3g} {UNIT}')
        moved = velocity is not None


def _joint_names(node: Node) -> list[str] | None:
    """Return the joints of the first joint_states; None if there are none in time."""
    names: list[str] = []
    node.create_subscription(JointState, 'joint_states', lambda m: names.extend(m.name), 1)
    until = time.monotonic() + WAIT_S
    while not names and time.monotonic() < until:
        rclpy.spin_once(node, timeout_sec=0.1)
    return names or None


def _say(names: list[str], speed: float) -> None:
    print('hold a key to move a joint, release it to stop:')
    for name, forward, backward in zip(names, FORWARD, BACKWARD, strict=False):
        print(f'  {forward} +  {backward} -  {name}')
    print(f'  + faster  - slower  x ends   ({speed:g} {UNIT}; the arm must be enabled)')


def _arguments(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='epson_driver jog',
        description='Moves single joints of an enabled arm while a key is held.',
        epilog='ROS arguments as everywhere, such as --ros-args -r __ns:=/left.',
        allow_abbrev=False,
    )
    parser.add_argument(
        '--speed',
        type=argument(SPEED),
        default=0.1,
        metavar='RAD/S',
        help='to begin with; m/s of a prismatic joint (%(default)g)',
    )
    parser.add_argument(
        '--node', default='epson_driver', metavar='NAME', help="the driver's node (%(default)s)"
    )
    return parser.parse_args(arguments)
