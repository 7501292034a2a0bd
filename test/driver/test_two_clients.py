# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Two `ClientNode`s in a program of one's own: one event loop, one executor, one context."""

import asyncio
import contextlib
import logging
import threading

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from support.driver_harness import simulated
from support.event_loop import run, until

from epson_driver.cli.processes import free_ros_domain
from epson_driver.node.node import ClientNode
from epson_driver.node.ros_log import RosLogHandler

PORTS = ('motion', 'state', 'io', 'remote')


@pytest.fixture
def make_node(monkeypatch):
    """Return a function that makes a served node of a namespace for a controller's ports."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context, served = rclpy.Context(), Future()
    rclpy.init(context=context, domain_id=free_ros_domain())
    executor = SingleThreadedExecutor(context=context)
    nodes = []

    def make(namespace, ports):
        overrides = [Parameter(f'{port}_port', value=getattr(ports, port)) for port in PORTS]
        node = Node('arm', namespace=namespace, context=context, parameter_overrides=overrides)
        nodes.append(node)
        executor.add_node(node)
        return node

    thread = threading.Thread(target=executor.spin_until_future_complete, args=(served,))
    thread.start()
    yield make
    served.set_result(None)
    thread.join()
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
    context.shutdown()


@contextlib.asynccontextmanager
async def driven(node):
    """Make a client of a node and run it."""
    client = ClientNode(node)
    task = asyncio.create_task(client.run())
    yield client
    await client.shut_down()
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


def test_each_drives_its_own_arm_and_stays_when_the_other_is_shut_down(make_node):
    async def scenario():
        async with (
            simulated() as (_, its),
            simulated() as (_, others),
            driven(make_node('left', its)) as first,
        ):
            async with driven(make_node('right', others)) as second:
                clients = (first, second)
                await until(lambda: all(c.driver.robot.status for c in clients))
                await until(lambda: all(c.driver.motion_link.connected for c in clients))
                await second.commands.enable()
                assert second.driver.gate.reason is None
                assert first.driver.gate.reason is not None
                await first.commands.enable()
            seen = len(first.driver.robot.arrivals)
            await until(lambda: len(first.driver.robot.arrivals) > seen + 20)
            assert first.driver.gate.reason is None
            assert not second.driver.state_link.connected

    run(scenario())


def test_what_a_driver_says_is_said_by_its_node(make_node, capfd):
    log = logging.getLogger('epson_driver')

    async def scenario():
        async with simulated() as (_, its), simulated() as (_, others):
            left, right = make_node('left', its), make_node('right', others)
            handler = RosLogHandler(left.get_logger())
            log.addHandler(handler)
            try:
                async with driven(left), driven(right) as second:
                    await until(lambda: second.driver.motion_link.connected)
            finally:
                log.removeHandler(handler)

    level = log.level
    log.setLevel(logging.INFO)
    try:
        run(scenario())
    finally:
        log.setLevel(level)
    said = capfd.readouterr().err
    assert '[right.arm]: motion link connected' in said
    assert '[right.arm]: arm disabled' not in said  # nobody had enabled it
