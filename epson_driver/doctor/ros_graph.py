# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Lists the drivers and the MoveIt of this ROS domain, as a separate process of the doctor.

Prints JSON. `moveit`: the joints of the robot in a running move_group, or null without one.
`drivers`: the values that each driver publishes about its arm in /diagnostics.
"""

import json
import sys
import time
from typing import Any
from xml.etree import ElementTree

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor

from epson_driver.node.ros_process import udp_by_default

MOVABLE = ('revolute', 'continuous', 'prismatic')

ARM = ': arm'


def main() -> int:
    timeout = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
    with udp_by_default():
        rclpy.init()
        node = rclpy.create_node('epson_driver_doctor')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    drivers: dict[str, dict[str, str]] = {}
    node.create_subscription(
        DiagnosticArray, '/diagnostics', lambda message: _take(message, drivers), 10
    )
    try:
        deadline = time.monotonic() + timeout
        while (time_left := deadline - time.monotonic()) > 0.0:  # a driver reports once a second
            executor.spin_once(timeout_sec=time_left)
        result = {'moveit': _joints(node, executor), 'drivers': list(drivers.values())}
        print(json.dumps(result))
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()
    return 0


def _take(message: Any, drivers: dict[str, dict[str, str]]) -> None:
    for status in message.status:
        values = {item.key: item.value for item in status.values}
        if status.name.endswith(ARM) and 'arm gate' in values:
            named = {
                'name': status.name.removesuffix(ARM),
                'host': status.hardware_id,
                'text': status.message,
            }
            drivers[status.name] = values | named


def _joints(node: Any, executor: Any) -> list[str] | None:
    match = [
        f'{namespace.rstrip("/")}/{name}'
        for name, namespace in node.get_node_names_and_namespaces()
        if name == 'move_group'
    ]
    if not match:
        return None
    client = node.create_client(GetParameters, f'{match[0]}/get_parameters')
    request = client.call_async(GetParameters.Request(names=['robot_description']))
    executor.spin_until_future_complete(request, timeout_sec=10.0)
    answer = request.result()
    if answer is None or not answer.values:
        return []
    return joints_of(answer.values[0].string_value)


def joints_of(description: str) -> list[str]:
    """Return the movable joints of a URDF, except joints that mimic other joints."""
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
