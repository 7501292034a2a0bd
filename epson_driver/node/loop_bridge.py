# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Passes ROS requests from rclpy's thread to the driver's event loop, and answers each one.

rclpy's executor ends with the first exception of a callback, and asyncio only logs one. Therefore
every request passes through here. An unexpected exception is answered with `success: false` and
the reason, and logged with its traceback. It also stops and disables the arm, because the state of
the request is unknown. The driver continues to serve.
"""

import asyncio
import contextlib
import threading
import traceback
from collections.abc import Awaitable, Callable, Coroutine
from contextvars import Context
from dataclasses import dataclass
from typing import Any, TypeVar

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.service import Service
from rclpy.task import Future

from epson_driver.driver.driver import Driver
from epson_driver.driver.tasks import report_error
from epson_driver.setup.setup import Setup

REQUEST_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""QoS of services, including the services of an action. The depth limits the number of pending
requests. With rclpy's default of 10, an eleventh request replaces the first, which is never
answered. 1000 is the depth of rclpy's own parameter services. KEEP_ALL has no bound: a client that
does not read its replies could block the thread that sends them and serves ~/stop."""

TURNS = 4
"""Number of consecutive executor turns without a request after which `all_taken` returns."""

TAKEN_TIMEOUT_S = 0.5
"""Timeout of `LoopBridge.all_taken`, s, because a client may send requests continuously."""

RESULTS_TIMEOUT_S = 0.3
"""Timeout for sending results when the process ends, s."""

RESULTS_LINGER_S = 0.2
"""Time for clients to receive the results before the process exits, s. Shared memory ends with
the process, and rmw does not acknowledge service responses, which include results."""

T = TypeVar('T')
ServiceCallback = Callable[[Any, Any], Awaitable[Any]]
"""Function that takes a request and an empty response, and returns the response."""


class DriverEndedError(RuntimeError):
    """The driver has ended or is ending, and accepts no more requests."""

    def __init__(self) -> None:
        super().__init__('the driver has ended')


class LoopBridge:
    """Passes the requests of one node to the driver's event loop. Must be created in that loop.

    * context: contextvars that identify the node's logger.
    * fault: called in the loop, with the reason, when a request fails unexpectedly.
    * then: what `fault` does, as a clause for the reply and the log.
    """

    def __init__(
        self,
        node: Node,
        context: Context,
        fault: Callable[[str], None],
        then: str = 'the arm is stopped and disabled',
    ) -> None:
        self._then = then
        self.node = node
        self.group = ReentrantCallbackGroup()
        """Callback group of everything that the node serves."""
        self._context = context
        self._fault = fault
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._futures: set[Future] = set()
        self._ended = False
        self._handed_over = 0
        for service in node.services:  # rclpy's own
            service.callback = _answering(service, node.get_logger())

    def create_service(self, kind: Any, name: str, serve: ServiceCallback) -> None:
        """Create a service whose response has `success` and `message`."""

        async def answer(request: Any, response: Any) -> Any:
            try:
                return await serve(request, response)
            except DriverEndedError as error:
                return kind.Response(message=str(error))
            except GeneratorExit:
                raise
            except BaseException as error:  # noqa: BLE001 - SystemExit would end the executor, too
                return kind.Response(message=self.failed(name, error))

        self.node.create_service(
            kind, name, answer, qos_profile=REQUEST_QOS, callback_group=self.group
        )

    def failed(self, what: str, error: BaseException) -> str:
        """Log an unexpected error, schedule `fault`, return the reason. Callable in any thread."""
        why = f'{what} failed: {type(error).__name__}: {error}'
        trace = ''.join(traceback.format_exception(error))
        self.node.get_logger().error(f'{why}, {self._then}\n{trace}')
        try:
            self.to_loop(self._fault, why)
        except DriverEndedError:
            return f'{why}, the driver has ended'
        return f'{why}, {self._then}, see the log'

    def to_loop(self, function: Callable[..., object], *arguments: object) -> None:
        """Schedule a function in the loop's thread and in this node's context.

        Raises DriverEndedError if the loop is closed. The loop's exception handler receives
        exceptions of the function.
        """
        try:
            self._loop.call_soon_threadsafe(_call, function, arguments, context=self._context)
        except RuntimeError as error:  # the loop is closed
            raise DriverEndedError from error

    def hand_over(self, request: Callable[..., object], *arguments: object) -> None:
        """Schedule a function that may move the arm (see `to_loop`). `all_taken` waits for it."""
        self._handed_over += 1
        self.to_loop(request, *arguments)

    async def in_loop(self, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Run a coroutine in the driver's loop and wait for it in rclpy's executor.

        Raises the exceptions of the coroutine, and DriverEndedError if the driver ends.
        """
        done = self.create_future()

        def finish(task: 'asyncio.Task[T]') -> None:
            error = DriverEndedError() if task.cancelled() else task.exception()
            self.resolve(done, error if error is not None else (task.result(),))

        async def run() -> T:
            return await work()

        def start() -> None:
            self._loop.create_task(run()).add_done_callback(finish)

        self.hand_over(start)
        (value,) = await self.wait_for(done)
        answer: T = value
        return answer

    def create_future(self) -> Future:
        """Return a new rclpy future. Raises DriverEndedError if the driver has ended."""
        future = Future()
        with self._lock:
            if self._ended:
                raise DriverEndedError
            self._futures.add(future)
        return future

    def resolve(self, future: Future, value: object) -> None:
        """Set the value of a future, once, or an exception that `wait_for` raises."""
        with self._lock:
            if future not in self._futures:
                return
            self._futures.remove(future)
        future.set_result(value)
        self.node.executor.wake()

    async def wait_for(self, future: Future) -> Any:
        """Wait for a future in rclpy's executor and return its value, or raise its exception."""
        value = await future
        if isinstance(value, BaseException):
            raise value
        return value

    async def all_taken(self) -> None:
        """Wait, in the loop, until the executor has passed on all requests that it had received.

        This takes several turns of the executor, which accepts one request of each action per
        turn, reads it in the next turn, and runs newer tasks before older ones.
        """
        executor, turns = self.node.executor, 0
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(TAKEN_TIMEOUT_S):
                while turns < TURNS:
                    before, passed = self._handed_over, asyncio.Event()
                    executor.create_task(self._loop.call_soon_threadsafe, passed.set)
                    await passed.wait()
                    turns = turns + 1 if before == self._handed_over else 0

    async def results_sent(self, is_busy: Callable[[], bool], *, busy: bool) -> None:
        """Wait, in the loop, until the results of goals are sent, before ROS is shut down.

        busy: whether goals existed when the shutdown started. is_busy: returns whether a goal has
        no result yet. Raises TimeoutError after RESULTS_TIMEOUT_S.
        """
        executor = self.node.executor
        async with asyncio.timeout(RESULTS_TIMEOUT_S):
            waiting = busy
            while waiting:  # one extra turn: the last result is sent right after its handle
                waiting = is_busy()
                passed = asyncio.Event()
                executor.create_task(self._loop.call_soon_threadsafe, passed.set)
                await passed.wait()
        if busy:
            await asyncio.sleep(RESULTS_LINGER_S)

    def end(self) -> None:
        """Resolve all pending futures with DriverEndedError, after the end of the loop."""
        with self._lock:
            self._ended = True
            pending = list(self._futures)
        for future in pending:
            self.resolve(future, DriverEndedError())


@dataclass(frozen=True)
class NodeContext:
    """A node's driver, its setup, and the bridge from rclpy's thread to its loop."""

    driver: Driver
    setup: Setup
    bridge: LoopBridge

    @property
    def node(self) -> Node:
        """The rclpy node."""
        return self.bridge.node

    @property
    def values(self) -> dict[str, Any]:
        """The node's parameters by name. They may change."""
        return self.setup.values


def _call(function: Callable[..., object], arguments: tuple[object, ...]) -> None:
    """Call a function, and report its exception to the exception handler of the loop."""
    try:
        function(*arguments)
    except Exception as error:  # noqa: BLE001 - it is reported
        report_error(f'{getattr(function, "__qualname__", function)} failed', error)


def _answering(service: Service, logger: RcutilsLogger) -> Callable[..., Any]:
    """Return a callback for rclpy's own services that answers even if the original one raises.

    For example, rclpy's set_parameters raises ValueError if a peer sends an invalid type. The
    driver is unaffected by such errors, so the arm is not stopped.
    """
    serve = service.callback

    def answer(request: Any, response: Any) -> Any:
        try:
            return serve(request, response)
        except Exception as error:  # noqa: BLE001 - it is logged and answered
            why = f'{service.service_name} failed: {type(error).__name__}: {error}'
            logger.error(why)
            response = service.srv_type.Response()
            result = SetParametersResult(reason=f'{why}, parameters before it may be set')
            if service.srv_type is SetParameters:
                response.results = [result] * len(request.parameters)
            elif service.srv_type is SetParametersAtomically:
                response.result = result
            return response

    return answer
