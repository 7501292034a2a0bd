# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Detection of nodes with the same name or services in the ROS graph."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
from rclpy.context import Context
from rclpy.node import Node
from std_srvs.srv import Trigger
from support.ros_peer import PATIENCE

from epson_driver.node.node import DuplicateNodes
from epson_driver.processes.processes import free_ros_domain

MakeNode = Callable[..., Node]


@pytest.fixture
def make_node(monkeypatch: pytest.MonkeyPatch) -> Iterator[MakeNode]:
    """Yield a function that makes nodes, each with a separate DDS participant."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    domain = free_ros_domain()
    with ExitStack() as stack:

        def make(name: str, namespace: str = '') -> Node:
            context = Context()
            context.init(domain_id=domain)
            stack.callback(context.shutdown)
            node = Node(name, namespace=namespace, context=context, start_parameter_services=False)
            stack.callback(node.destroy_node)
            return node

        yield make


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end


def test_second_node_or_service_of_the_same_name_is_found(make_node: MakeNode) -> None:
    node = make_node('driver', 'left')
    node.create_service(Trigger, '~/enable', lambda request, response: response)
    find = DuplicateNodes(node)
    others = [make_node('driver', 'right'), make_node('other', 'left')]
    until(lambda: len(node.get_node_names()) == 3)
    assert find() == ''
    same_name = make_node('driver', 'left')
    until(lambda: find().startswith('/left/driver'))
    same_name.destroy_node()
    until(lambda: find() == '')
    others[1].create_service(Trigger, 'driver/enable', lambda request, response: response)
    pid = os.getpid() % 2**16
    until(lambda: find() == f'/left/driver/enable, process {pid} (modulo 65536) on this machine')
