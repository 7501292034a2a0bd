# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A program that discovers robots, for the test with two hosts.

It prints a line for each event, with the time (CLOCK_MONOTONIC, s), until SIGINT:

* `created TIME`: the program becomes a DDS participant
* `seen NAME TIME`: first message of that robot's driver
* with --states: `heard NAME TIME` (joint states arrive), `silent NAME TIME` (none for SILENCE_S)
  and `gone NAME TIME` (DDS has removed that robot)
"""

import argparse
import time
from functools import partial
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

SILENCE_S = 2.0
TURN_S = 0.1


class Observer:
    """Subscribes to each robot's latched link state, and to its joint states."""

    def __init__(self, node: Node, names: list[str], *, states: bool) -> None:
        self._node = node
        self._seen: set[str] = set()
        self._silent: set[str] = set()
        self._last: dict[str, float] = {}
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for name in names:
            link = f'/{name}/epson_driver/link_state'
            node.create_subscription(String, link, partial(self._on_link, name), latched)
            if states:
                node.create_subscription(
                    JointState, f'/{name}/joint_states', partial(self._on_state, name), 10
                )

    def poll(self) -> None:
        """Print the robots that became silent or disappeared."""
        now = time.monotonic()
        for name, last in list(self._last.items()):
            if now - last > SILENCE_S:
                del self._last[name]
                self._silent.add(name)
                print_event('silent', name)
        for name in list(self._silent):
            if not self._node.count_publishers(f'/{name}/joint_states'):
                self._silent.discard(name)
                print_event('gone', name)

    def _on_link(self, name: str, _message: Any) -> None:
        if name not in self._seen:
            self._seen.add(name)
            print_event('seen', name)

    def _on_state(self, name: str, _message: Any) -> None:
        if name not in self._last:
            self._silent.discard(name)
            print_event('heard', name)
        self._last[name] = time.monotonic()


def print_event(*words: str) -> None:
    """Print the words and the time."""
    print(*words, f'{time.monotonic():.3f}', flush=True)


def main() -> None:
    """Observe until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='+')
    parser.add_argument('--states', action='store_true')
    arguments = parser.parse_args()
    rclpy.init()
    print_event('created')
    node = rclpy.create_node('observer')
    observer = Observer(node, arguments.names, states=arguments.states)
    try:
        while rclpy.ok():
            rclpy.spin_once(node, timeout_sec=TURN_S)
            observer.poll()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
