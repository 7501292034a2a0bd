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
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState

from epson_driver.cli.arguments import argument
from epson_driver.driver.remedy import Remedy, with_remedy
from epson_driver.inputs import number, printable
from epson_driver.node.remedies import WORDS
from epson_driver.node.sampling import level, sampled, take, take_all

PERIOD_S = 0.02
"""Time between two messages while a key is held, s."""

WAIT_S = 10.0
"""How long to wait for the driver, s."""

IDLE_S = 0.1
"""How often the driver is listened to while no key is held, s."""

MOST = 20
"""Messages of one topic that wait; diagnostics come once a second, of every driver."""

JOINTS_SILENT_S, DRIVER_SILENT_S = 0.5, 2.5
"""After what time without joint states, or diagnostics, that is said, s."""

WARN = 30
TOPIC = '~/joint_jog'
"""As the driver calls it in its log."""

RELEASE_S = 0.15
"""A key that did not come again for so long was released, s. Terminals repeat a key 10 to 30 times
a second, but begin with that later: until then a held key moves its joint only for this time."""

FORWARD = '1234567890'
BACKWARD = 'qwertyuiop'
"""The keys of the joints, in their order: below each other on most keyboards."""

FASTER, SLOWER = '+', '-'
ENDS = frozenset({'x', '\x03', '\x04', '\x1b', ''})
"""x, Ctrl-C, Ctrl-D, Escape, or the end of the input."""

STEP = 1.5
"""The ratio of two speeds."""

MIN_SPEED, MAX_SPEED = 0.01, 2.0
"""rad/s or m/s; the driver goes no faster than servo.scale allows."""

SPEED = number(MIN_SPEED, MAX_SPEED, 'rad/s')
UNIT = 'rad/s (m/s of a joint that slides)'


class JogKeys:
    """Turns characters into velocities of `joints` joints. Times are monotonic, s.

    A terminal tells of no key that is released: a key that is held comes again and again, one that
    was released does not. So each character moves its joint for RELEASE_S.
    """

    def __init__(self, joints: int, speed: float) -> None:
        self.speed = speed
        self.ended = False
        self._joints = min(joints, len(FORWARD))
        self._joint = 0
        self._sign = 0.0
        self._until = float('-inf')

    def press(self, key: str, now: float) -> None:
        """Take a character. One without a meaning stops the motion."""
        self._until = float('-inf')
        if key in ENDS:
            self.ended = True
        elif key in (FASTER, SLOWER):
            speed = self.speed * (STEP if key == FASTER else 1.0 / STEP)
            self.speed = min(max(speed, MIN_SPEED), MAX_SPEED)
        else:
            for keys, sign in ((FORWARD, 1.0), (BACKWARD, -1.0)):
                joint = keys.find(key)
                if 0 <= joint < self._joints:
                    self._joint, self._sign = joint, sign
                    self._until = now + RELEASE_S

    def velocity(self, now: float) -> tuple[int, float] | None:
        """Return the index of the joint that moves and its velocity, or None."""
        if self.ended or now >= self._until:
            return None
        return self._joint, self._sign * self.speed


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
        why = WhyNot(node, args.node)
        before = termios.tcgetattr(sys.stdin)
        try:
            tty.setcbreak(sys.stdin)
            _jog(names, args.speed, publisher.publish, why)
        finally:
            publisher.publish(JointJog(joint_names=names, velocities=[0.0] * len(names)))
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
    finally:
        node.destroy_node()
        rclpy.shutdown()
    return 0


class WhyNot:
    """What keeps the arm from moving: what its driver says, or that it is silent."""

    def __init__(self, node: Node, driver: str) -> None:
        name = node.resolve_service_name(driver).lstrip('/')
        self._arm, self._logger = f'{name}: arm', name.replace('/', '.')
        self._diagnostics = sampled(node, DiagnosticArray, '/diagnostics', MOST)
        self._log = sampled(node, Log, '/rosout', MOST)
        self._joints = sampled(node, JointState, 'joint_states', 1)
        self._held = ''
        self._told = self._moved = time.monotonic()

    def __call__(self, now: float) -> tuple[str, list[str]]:
        """Return the reason, '' if there is none, and what the driver said since the last time."""
        if take(self._joints) is not None:
            self._moved = now
        for message in take_all(self._diagnostics, MOST):
            for status in message.status:
                if status.name == self._arm:
                    self._told, self._held = now, _held(status)
        lines = [each for each in take_all(self._log, MOST) if each.name == self._logger]
        said = [each.msg for each in lines if level(each) >= WARN and TOPIC in each.msg]
        return self._reason(now), said

    def _reason(self, now: float) -> str:
        if now - self._told > DRIVER_SILENT_S:
            return 'its driver is silent: look whether it runs'
        if not self._held and now - self._moved > JOINTS_SILENT_S:
            return 'no joint_states come: look whether the driver and the controller run'
        return self._held


def _held(arm: DiagnosticStatus) -> str:
    """Return what keeps the arm from moving and what helps, '' if nothing does."""
    values = {each.key: each.value for each in arm.values}
    remedy = Remedy.__members__.get(values.get('remedy', ''), Remedy.NONE)
    held = values.get('cause', 'NONE') != 'NONE'
    return with_remedy(arm.message, remedy, WORDS) if held else ''


def _jog(
    names: list[str],
    speed: float,
    publish: Callable[[JointJog], None],
    why_not: Callable[[float], tuple[str, list[str]]],
) -> None:
    """Publish a velocity while a key is held, and all zero once when it is released.

    `why_not`: what keeps the arm from moving, and what the driver says of it, both said at once.
    """
    keys = JogKeys(len(names), speed)
    moved, known = False, ''
    while not keys.ended:
        ready, _, _ = select.select([sys.stdin], [], [], PERIOD_S if moved else IDLE_S)
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
        why, said = why_not(now)
        if velocity is not None and why and (why != known or not moved):
            print(f'the arm does not move: {printable(why)}')
        elif not why:
            for line in said:
                print(printable(line))
        known = why
        if ready and velocity is None and not keys.ended:
            print(f'{keys.speed:.3g} {UNIT}')
        moved = velocity is not None


def _joint_names(node: Node) -> list[str] | None:
    """Return the joints of the first joint_states, or None if there are none in time."""
    states = sampled(node, JointState, 'joint_states', 1)
    until = time.monotonic() + WAIT_S
    while (state := take(states)) is None and time.monotonic() < until:
        time.sleep(PERIOD_S)
    node.destroy_subscription(states)
    return None if state is None else list(state.name)


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
