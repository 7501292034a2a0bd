# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A program that looks for robots, for the test with two hosts.

It prints a line for each thing it sees, with the time (CLOCK_MONOTONIC, s), until it is ended:

* `created TIME`: it begins to be a participant of DDS;
* `seen NAME TIME`: the first message of that robot's driver has come;
* with --states `heard NAME TIME`, `silent NAME TIME`: joint states come (again); none came for a
  while; `gone NAME TIME`: DDS has given that robot up.
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
    """Subscribes to what each robot keeps for those who come late, and to its joint states."""

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

    def look(self) -> None:
        """Say who is silent now."""
        now = time.monotonic()
        for name, last in list(self._last.items()):
            if now - last > SILENCE_S:
                del self._last[name]
                self._silent.add(name)
                tell('silent', name)
        for name in list(self._silent):
            if not self._node.count_publishers(f'/{name}/joint_states'):
                self._silent.discard(name)
                tell('gone', name)

    def _on_link(self, name: str, _message: Any) -> None:
        if name not in self._seen:
            self._seen.add(name)
            tell('seen', name)

    def _on_state(self, name: str, _message: Any) -> None:
        if name not in self._last:
            self._silent.discard(name)
            tell('heard', name)
        self._last[name] = time.monotonic()


def tell(*words: str) -> None:
    """Print a line that ends with the time."""
    print(*words, f'{time.monotonic():.3f}', flush=True)


def main() -> None:
    """Look until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='+')
    parser.add_argument('--states', action='store_true')
    arguments = parser.parse_args()
    rclpy.init()
    tell('created')
    node = rclpy.create_node('observer')
    observer = Observer(node, arguments.names, states=arguments.states)
    try:
        while rclpy.ok():
            rclpy.spin_once(node, timeout_sec=TURN_S)
            observer.look()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
