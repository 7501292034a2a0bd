# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Asks a running MoveIt for the joints of its robot; for the doctor, as a process of its own.

Prints JSON: a list of names, or null if there is no move_group.
"""

import json
import sys
import time
from typing import Any
from xml.etree import ElementTree

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor

MOVABLE = ('revolute', 'continuous', 'prismatic')


def main() -> int:
    """Look for move_group for as many seconds as the first argument says."""
    patience = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
    rclpy.init()
    node = rclpy.create_node('epson_driver_doctor')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        print(json.dumps(_joints(node, executor, time.monotonic() + patience)))
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()
    return 0


def _joints(node: Any, executor: Any, until: float) -> list[str] | None:
    while True:
        found = [
            f'{namespace.rstrip("/")}/{name}'
            for name, namespace in node.get_node_names_and_namespaces()
            if name == 'move_group'
        ]
        if found:
            break
        if time.monotonic() > until:
            return None
        executor.spin_once(timeout_sec=0.1)
    client = node.create_client(GetParameters, f'{found[0]}/get_parameters')
    asked = client.call_async(GetParameters.Request(names=['robot_description']))
    executor.spin_until_future_complete(asked, timeout_sec=10.0)
    answer = asked.result()
    if answer is None or not answer.values:
        return []
    return joints_of(answer.values[0].string_value)


def joints_of(description: str) -> list[str]:
    """Return the joints of a URDF that move, without those that mimic others."""
    try:
        root = ElementTree.fromstring(description)  # noqa: S314 - expat expands no entity bombs
    except ElementTree.ParseError:
        return []
    return [
        str(joint.get('name'))
        for joint in root.iter('joint')
        if joint.get('type') in MOVABLE and joint.find('mimic') is None
    ]


if __name__ == '__main__':
    sys.exit(main())
