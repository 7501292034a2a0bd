# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The process of one or more ROS 2 nodes. It ends on a signal or after a failure."""

import asyncio
import gc
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from epson_driver.inputs import printable
from epson_driver.node.node import ClientNode
from epson_driver.node.ros_process import RosLogHandler, RosThread, udp_by_default
from epson_driver.processes.command import raise_priority
from epson_driver.processes.interrupt import ended_by_signals, ignore_interrupts
from epson_driver.setup.robot_file import fits_node, node_sections

DEFAULT_NAME = 'epson_driver'

_log = logging.getLogger(__name__)


class Client(Protocol):
    """Interface of an object that serves a ROS node and moves an arm, such as ClientNode."""

    async def run(self) -> None:
        """Serve until cancelled."""

    async def shut_down(self) -> None:
        """Stop the arm, and send every goal's result."""

    def end(self) -> None:
        """Answer every pending request."""


Make = Callable[[Node], Client]


def run(namespaces: Sequence[str], make: Make = ClientNode, name: str = DEFAULT_NAME) -> int:
    """Run one node per namespace until a signal or a failure, and return the exit code.

    The exit code is 1 if a name or a parameter is invalid, or if a thread, a task or a callback
    has failed. All arms are stopped and all goals are ended before this returns.
    """
    nodes: list[Node] = []
    try:
        with udp_by_default():
            # The event loop handles the signals, so results can still be published after Ctrl-C.
            rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
            created = _make_nodes(namespaces, nodes, name)
    except (OSError, RuntimeError, ValueError) as error:  # from rcl (ValueError: invalid text)
        print(f'{name}: {printable(error)}', file=sys.stderr)
        return 1
    try:
        if not created:
            return 1
        handler = RosLogHandler(nodes[0].get_logger())
        logging.basicConfig(level=logging.INFO, handlers=[handler], format='%(message)s')
        return _run(nodes, make)
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()


class Failures:
    """Collects failures of the process's threads, tasks and callbacks.

    The first ends the process.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._reported: list[BaseException] = []
        self.happened = asyncio.Event()

    def report(self, what: str, error: BaseException) -> None:
        self.happened.set()
        if not any(error is known for known in self._reported):
            self._reported.append(error)
            _log.critical('%s: stopping all arms and the driver', what, exc_info=error)

    def in_loop(self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Report an error that asyncio would only log."""
        error = context.get('exception')
        if error is None:
            _log.error('%s', context['message'])
        else:
            self.report(context['message'], error)

    def in_thread(self, what: str, error: BaseException) -> None:
        """Report a failure of a thread, even if the loop has ended. Any thread may call this."""
        try:
            self._loop.call_soon_threadsafe(self.report, what, error)
        except RuntimeError:  # the loop is closed
            self.report(what, error)

    def on_thread_end(self, arguments: Any) -> None:
        name = '' if arguments.thread is None else arguments.thread.name
        self.in_thread(f'the thread {name} ended', arguments.exc_value)


def _make_nodes(namespaces: Sequence[str], nodes: list[Node], name: str) -> bool:
    """Create one node per namespace. If one cannot be created, log why and return False."""
    logger = rclpy.logging.get_logger(name)
    for namespace in namespaces:
        try:
            nodes.append(Node(name, namespace=namespace))
        except NameValidationException as error:
            logger.fatal(printable(f'--namespace {namespace}: {error}'))
            return False
        except (ParameterException, RuntimeError, ValueError) as error:  # rclpy's own parameters
            logger.fatal(printable(error))
            return False
    names = [node.get_fully_qualified_name() for node in nodes]
    twice = {name for name in names if names.count(name) > 1}
    if twice:  # __ns remaps them all
        logger.fatal(
            f'{", ".join(twice)}: two robots have this name, so give each its own --namespace'
        )
    for sentence in _unused_files(sys.argv, names):
        logger.warning(sentence)
    return not twice


def _unused_files(words: Sequence[str], names: Sequence[str]) -> Iterator[str]:
    for option, path in pairwise(words):
        if option != '--params-file':
            continue
        sections = node_sections(Path(path))  # rcl has read it
        if not any(fits_node(section, name) for section in sections for name in names):
            yield (
                f'{path} is ignored: it has parameters for {", ".join(sections) or "no node"}, '
                f'not for {", ".join(names)}'
            )


def _run(nodes: Sequence[Node], make: Make) -> int:
    raise_priority()
    signaled = asyncio.Event()
    with (
        asyncio.Runner() as runner,
        ended_by_signals(loop := runner.get_loop(), signaled.set),
    ):
        failures = Failures(loop)
        loop.set_exception_handler(failures.in_loop)
        threading.excepthook = failures.on_thread_end
        ros = RosThread(failures.in_thread)
        for node in nodes:
            ros.executor.add_node(node)
        clients: list[Client] = []
        driving = loop.create_task(_drive(nodes, clients, ros, signaled, failures, make))
        while not driving.done():
            try:
                loop.run_until_complete(driving)
            except BaseException as error:  # noqa: BLE001 - it is reported
                # asyncio re-raises the SystemExit of a callback or a task immediately
                failures.report('the event loop ended', error)
    ignore_interrupts()  # the arms are at rest, and the remaining steps are short
    for client in clients:
        client.end()
    if not ros.leave():  # a blocked thread cannot be ended, but the arms are at rest
        _log.critical('ROS executor thread did not stop')
        logging.shutdown()
        os._exit(1)
    ros.executor.shutdown()
    return 1 if failures.happened.is_set() else driving.result()


def _make_clients(nodes: Sequence[Node], clients: list[Client], make: Make) -> bool:
    for node in nodes:
        try:
            clients.append(make(node))
        except (ValueError, ParameterException) as error:
            name = f'{node.get_fully_qualified_name()}: ' if len(nodes) > 1 else ''
            node.get_logger().fatal(printable(f'{name}{error}'))
    return len(clients) == len(nodes)


async def _drive(
    nodes: Sequence[Node],
    clients: list[Client],
    ros: RosThread,
    signaled: asyncio.Event,
    failures: Failures,
    make: Make = ClientNode,
) -> int:
    if not _make_clients(nodes, clients, make):
        return 1
    gc.collect()
    gc.freeze()  # objects that exist now are never freed: a scan of them stalls the loop for 15 ms
    ros.start()
    running = [asyncio.create_task(client.run()) for client in clients]
    endings = [asyncio.create_task(event.wait()) for event in (signaled, failures.happened)]
    await asyncio.wait([*running, *endings], return_when=asyncio.FIRST_COMPLETED)
    _report_ended(running, failures)
    # In parallel. After a TimeoutError results may be unpublished, but the arm has stopped.
    stopping = [client.shut_down() for client in clients]
    for outcome in await asyncio.gather(*stopping, return_exceptions=True):
        if isinstance(outcome, BaseException) and not isinstance(outcome, TimeoutError):
            failures.report('stopping an arm failed', outcome)
    _report_ended(running, failures)
    for task in (*running, *endings):
        task.cancel()
    for outcome in await asyncio.gather(*running, return_exceptions=True):
        if isinstance(outcome, Exception):
            failures.report('a driver failed', outcome)
    await asyncio.gather(*endings, return_exceptions=True)
    return 0


def _report_ended(running: Sequence['asyncio.Task[None]'], failures: Failures) -> None:
    for task in running:
        if task.cancelled():
            failures.report('a driver was cancelled', asyncio.CancelledError())
        elif task.done():
            error = task.exception()
            failures.report(
                'a driver ended', error or RuntimeError('(internal) unexpected task exit')
            )
