# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`ros2 run epson_driver client`: the ROS 2 node, or several of them in one process."""

import argparse
import asyncio
import contextlib
import gc
import logging
import signal
import sys
import threading
from collections.abc import Sequence

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from epson_driver.client.node import ClientNode
from epson_driver.client.parameter_service import CheckedParameterService
from epson_driver.client.ros_log import RosLogHandler
from epson_driver.inputs import printable

DEFAULT_NAME = 'epson_driver'


def main() -> int:
    """Run until SIGINT or SIGTERM; then stop the arms, end their goals, and leave.

    Returns 0; 1 if a name or a parameter cannot be used. No arm is driven then.
    """
    try:
        namespaces = _namespaces(remove_ros_args(sys.argv)[1:])
        # The signals come to the event loop: results can still be published after Ctrl-C.
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    except (RuntimeError, ValueError) as error:  # rcl's, and what is no text
        print(f'client: {printable(error)}', file=sys.stderr)
        return 1
    executor = SingleThreadedExecutor()
    served = Future()  # until then; shutting an executor down while it works raises in its thread
    thread = threading.Thread(target=_spin, args=(executor, served), name='rclpy executor')
    nodes: list[Node] = []
    try:
        if not _make_nodes(namespaces, nodes):
            return 1
        for node in nodes:
            executor.add_node(node)
        handler = RosLogHandler(nodes[0].get_logger())
        logging.basicConfig(level=logging.INFO, handlers=[handler], format='%(message)s')
        return asyncio.run(_drive(nodes, thread))
    finally:
        served.set_result(None)
        if thread.is_alive():
            thread.join()
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()


def _namespaces(arguments: Sequence[str]) -> list[str]:
    parser = argparse.ArgumentParser(
        prog='client',
        description='The ROS 2 node that drives a controller, or several in one process: one for '
        'each --namespace.',
        epilog='ROS arguments as everywhere: --ros-args -p robot_ip:=192.168.0.1; for several '
        'robots --ros-args --params-file FILE, with /NAME/epson_driver: ros__parameters: …',
    )
    parser.add_argument(
        '--namespace',
        metavar='NAME',
        action='append',
        help="a robot's namespace; once for each robot (none: one robot, where __ns says)",
    )
    return parser.parse_args(arguments).namespace or ['']


def _make_nodes(namespaces: Sequence[str], nodes: list[Node]) -> bool:
    """Make a node for each namespace; return whether all could be made, or log why not."""
    logger = rclpy.logging.get_logger(DEFAULT_NAME)
    for namespace in namespaces:
        try:
            node = Node(DEFAULT_NAME, namespace=namespace, start_parameter_services=False)
            nodes.append(node)
            CheckedParameterService(node)
        except NameValidationException as error:
            logger.fatal(printable(f'--namespace {namespace}: {error}'))
            return False
        except (
            ParameterException,
            RuntimeError,
            ValueError,
        ) as error:  # of rclpy's own parameters
            logger.fatal(printable(error))
            return False
    names = [node.get_fully_qualified_name() for node in nodes]
    twice = {name for name in names if names.count(name) > 1}
    if twice:  # __ns remaps them all
        logger.fatal(f'{", ".join(twice)}: two robots have this name; give each its --namespace')
    return not twice


def _spin(executor: SingleThreadedExecutor, served: Future) -> None:
    with contextlib.suppress(ExternalShutdownException):
        executor.spin_until_future_complete(served)


def _make_clients(nodes: Sequence[Node]) -> list[ClientNode]:
    """Return the clients of all nodes that have one; the log says why another has none."""
    clients = []
    for node in nodes:
        try:
            clients.append(ClientNode(node))
        except (ValueError, FileNotFoundError, ParameterException) as error:
            name = f'{node.get_fully_qualified_name()}: ' if len(nodes) > 1 else ''
            node.get_logger().fatal(printable(f'{name}{error}'))
    return clients


async def _drive(nodes: Sequence[Node], executor_thread: threading.Thread) -> int:
    clients = _make_clients(nodes)
    if len(clients) < len(nodes):
        return 1
    gc.collect()
    gc.freeze()  # what start-up made is never freed: searching it would hold the loop for 15 ms
    executor_thread.start()
    running = [asyncio.create_task(client.run()) for client in clients]
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ended.set)
    waiting = asyncio.create_task(ended.wait())
    await asyncio.wait([*running, waiting], return_when=asyncio.FIRST_COMPLETED)
    # all at once; what is too late (TimeoutError) loses its results, but not the time
    stopping = [
        client.shut_down()
        for client, task in zip(clients, running, strict=True)
        if not task.done()
    ]
    await asyncio.gather(*stopping, return_exceptions=True)
    for task in (*running, waiting):
        task.cancel()
    ends = await asyncio.gather(*running, return_exceptions=True)
    for end in ends:
        if isinstance(end, Exception):
            raise end
    return 0


if __name__ == '__main__':
    sys.exit(main())
