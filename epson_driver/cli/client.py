# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`ros2 run epson_driver client`: the ROS 2 node."""

import asyncio
import contextlib
import gc
import logging
import signal
import sys
import threading

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from epson_driver.client.node import ClientNode, RosLogHandler

DEFAULT_NAME = 'epson_driver'


def main() -> int:
    """Run until SIGINT or SIGTERM; then stop the arm, end the goal, and leave. Returns 0."""
    # The signals come to the event loop: results can still be published after Ctrl-C.
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    node = Node(DEFAULT_NAME)
    handler = RosLogHandler(node.get_logger())
    logging.basicConfig(level=logging.INFO, handlers=[handler], format='%(message)s')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=_spin, args=(executor,), name='rclpy executor')
    try:
        return asyncio.run(_drive(node, thread))
    finally:
        executor.shutdown()
        if thread.is_alive():
            thread.join()
        node.destroy_node()
        rclpy.shutdown()


def _spin(executor: SingleThreadedExecutor) -> None:
    with contextlib.suppress(ExternalShutdownException):
        executor.spin()


async def _drive(node: Node, executor_thread: threading.Thread) -> int:
    try:
        client = ClientNode(node)
    except (ValueError, FileNotFoundError, rclpy.exceptions.ParameterException) as error:
        node.get_logger().fatal(str(error))
        return 1
    gc.collect()
    gc.freeze()  # what start-up made is never freed: searching it would hold the loop for 15 ms
    executor_thread.start()
    running = asyncio.create_task(client.run())
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ended.set)
    waiting = asyncio.create_task(ended.wait())
    await asyncio.wait([running, waiting], return_when=asyncio.FIRST_COMPLETED)
    if not running.done():
        with contextlib.suppress(TimeoutError):  # then the results are lost, but not the time
            await client.shut_down()
    running.cancel()
    waiting.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    return 0


if __name__ == '__main__':
    sys.exit(main())
