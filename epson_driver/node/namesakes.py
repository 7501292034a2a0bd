# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Detects other nodes with this node's name or services. Two drivers would obey one request."""

import os
from typing import Any

from rclpy.node import Node

LOOK_PERIOD_S = 0.25
"""Polling period, s. rclpy has no events for graph changes."""

DISCOVERY_S = 2.0
"""Time within which nodes discover each other, s (measured on a busy machine: 1.2 s)."""

FAST_DDS = bytes((1, 15))
"""First bytes of Fast DDS GUIDs, followed by host and process, 16 bits each."""


class Namesakes:
    """Finds namesakes in the ROS graph. Must be created after the services of the node."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._names = [
            node.resolve_service_name('~/follow_joint_trajectory/_action/send_goal'),
            *(service.service_name for service in node.services),
        ]

    def __call__(self) -> str:
        """Return their name and processes as a clause, or '' if none exist."""
        node = self._node
        name = next((each for each in self._names if node.handle.get_count_services(each) > 1), '')
        own = (node.get_name(), node.get_namespace())
        if not name and node.get_node_names_and_namespaces().count(own) < 2:
            return ''
        return (name or node.get_fully_qualified_name()) + self._processes(name)

    def _processes(self, service: str) -> str:
        """Return the processes of the other nodes, as identified by Fast DDS GUIDs."""
        found: list[Any] = self._node.get_subscriptions_info_by_topic(
            f'rq{service}Request', no_mangle=True
        )
        guids = {bytes(each.endpoint_gid[:12]) for each in found}
        known = sorted(guid for guid in guids if guid.startswith(FAST_DDS))
        own = next((guid for guid in known if _process(guid) == os.getpid() % 2**16), b'')
        return ''.join(
            f', process {_process(guid)} (modulo 65536) on '
            + ('this machine' if guid[2:4] == own[2:4] else f'host {guid[2:4].hex()} of DDS')
            for guid in known
            if guid != own
        )


def _process(guid: bytes) -> int:
    return int.from_bytes(guid[4:6], 'little')
