# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Passes ROS requests from rclpy's thread to the driver's event loop, and answers each one.

rclpy's executor ends at the first exception of a callback, and asyncio only logs an exception.
Therefore every request passes through this module. If an unexpected exception is raised, the reply
has `success: false` and the reason, and the log has the traceback. The arm is also stopped and
disabled, because the state of the request is unknown. The driver continues to serve.
"""

import asyncio
import contextlib
import threading
import traceback
from collections.abc import Awaitable, Callable, Coroutine
from contextvars import Context
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeVar

from action_msgs.msg import GoalStatus
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.service import Service
from rclpy.task import Future

from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.planning_cancellation import PlanningCancellation
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.driver.tasks import report_error
from epson_driver.node.messages import outcome_text
from epson_driver.setup.setup import Setup

REQUEST_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""QoS of services, including the services of an action. The depth limits the number of pending
requests. With rclpy's default of 10, an eleventh request replaces the first one, which is then
never answered. 1000 is the depth of rclpy's own parameter services. KEEP_ALL has no bound, so a
client that does not read its replies could block the thread that sends them and serves ~/stop."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""QoS of topics, such as `/tf_static`, whose last message reaches late subscribers."""

TURNS = 4
"""Number of consecutive executor cycles without a request after which `all_taken` returns."""

TAKEN_TIMEOUT_S = 0.5
"""Timeout of `LoopBridge.all_taken`, s, because a client may send requests continuously."""

RESULTS_TIMEOUT_S = 0.3
"""Timeout for sending results when the process ends, s."""

RESULTS_LINGER_S = 0.2
"""Time for clients to receive the results before the process exits, s. It is needed because shared
memory ends with the process, and rmw does not acknowledge service responses, such as results."""

T = TypeVar('T')
ServiceCallback = Callable[[Any, Any], Awaitable[Any]]
"""Function that takes a request and an empty response, and returns the response."""


CANCELED = Outcome(End.CANCELED, ErrorCode.SUCCESSFUL, 'canceled before it could start')


class DriverEndedError(RuntimeError):
    def __init__(self) -> None:
        super().__init__('the driver has ended')


class LoopBridge:
    """Passes the requests of one node to the driver's event loop. Must be created in that loop.

    When a request fails unexpectedly, `fault` is called in the loop with the reason. `then`
    describes the effect of `fault` in the reply and in the log.
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
        """Callback group of all services, actions and subscriptions of the node."""
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

    def create_action(self, kind: Any, name: str, execute: Any, **options: Any) -> ActionServer:
        return ActionServer(
            self.node,
            kind,
            name,
            execute,
            callback_group=self.group,
            goal_service_qos_profile=REQUEST_QOS,
            result_service_qos_profile=REQUEST_QOS,
            cancel_service_qos_profile=REQUEST_QOS,
            **options,
        )

    def failed(self, what: str, error: BaseException) -> str:
        """Log an unexpected error, schedule `fault`, and return the reason.

        Any thread may call this.
        """
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

        Raises DriverEndedError if the loop is closed. An exception of the function is passed to
        the loop's exception handler.
        """
        try:
            self._loop.call_soon_threadsafe(_call, function, arguments, context=self._context)
        except RuntimeError as error:  # the loop is closed
            raise DriverEndedError from error

    def hand_over(self, request: Callable[..., object], *arguments: object) -> None:
        """Schedule a function that may move the arm, like `to_loop`.

        `all_taken` waits for its call.
        """
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
        future = Future()
        with self._lock:
            if self._ended:
                raise DriverEndedError
            self._futures.add(future)
        return future

    def resolve(self, future: Future, value: object) -> None:
        """Set the value of a future once. If the value is an exception, `wait_for` raises it."""
        with self._lock:
            if future not in self._futures:
                return
            self._futures.remove(future)
        future.set_result(value)
        self.node.executor.wake()

    async def wait_for(self, future: Future) -> Any:
        value = await future
        if isinstance(value, BaseException):
            raise value
        return value

    async def all_taken(self) -> None:
        """Wait, in the loop, until the executor has passed all received requests to the loop.

        This takes several cycles of the executor. In one cycle, the executor accepts one request
        of each action. It reads this request in the next cycle, and runs newer tasks before older
        ones.
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

        busy: whether goals existed when the shutdown started. is_busy: function that returns
        whether a goal has no result yet. Raises TimeoutError after RESULTS_TIMEOUT_S.
        """
        executor = self.node.executor
        async with asyncio.timeout(RESULTS_TIMEOUT_S):
            waiting = busy
            while waiting:  # one extra turn, because the last result is sent after its handle ends
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


class Queue(Protocol):
    """Interface of a queue of goals. Its methods are called in the driver's event loop."""

    def submit(self, handle: Any) -> None:
        """Execute a goal, and report its outcome to the handle."""

    def cancel(self, handle: Any) -> None:
        """Cancel a submitted goal."""


OnEnd = Callable[[Outcome], None]

Prepare = Callable[[ServerGoalHandle, PlanningCancellation, OnEnd], Awaitable[Any]]
"""Function that checks a request, plans its goal, and returns the goal for the queue. The queue
calls OnEnd with the outcome. The function runs in the executor, and may raise GoalRejectedError.
Canceling the goal ends the PlanningCancellation, which interrupts the planning."""

RESULT_TIMEOUT_S = 60
"""Time for which a goal and its result are stored for late requests, s. With rclpy's default, the
points of all goals of the last 15 minutes would be stored."""


class GoalAction:
    """Serves an action of the ROS type `kind`. `result` converts an outcome to a ROS result."""

    def __init__(
        self,
        bridge: LoopBridge,
        queue: Queue,
        kind: Any,
        name: str,
        prepare: Prepare,
        result: Callable[[Outcome], Any],
    ) -> None:
        self._logger = bridge.node.get_logger()
        self._name = name
        self._prepare = prepare
        self._result = result
        self._queue = queue
        self._bridge = bridge
        self._cancel_of: dict[bytes, Callable[[], None]] = {}
        """For each goal without a result, by id, the function that cancels it in the loop."""
        self.server = bridge.create_action(
            kind,
            name,
            self._execute,
            goal_callback=lambda goal: GoalResponse.ACCEPT,  # only accepted goals have a result
            cancel_callback=self._cancel,
            result_timeout=RESULT_TIMEOUT_S,
        )

    @property
    def busy(self) -> bool:
        return bool(self._cancel_of)

    async def _execute(self, ros_handle: ServerGoalHandle) -> Any:
        key = bytes(ros_handle.goal_id.uuid)
        plan = PlanningCancellation()
        self._cancel_of[key] = partial(plan.end, CANCELED.text)
        try:
            outcome = await self._outcome(key, ros_handle, plan)
        except GoalRejectedError as rejection:
            outcome = CANCELED if ros_handle.is_cancel_requested else rejection.outcome
        except DriverEndedError as error:
            outcome = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, str(error))
        except Exception as error:  # noqa: BLE001 - it is logged, answered, and stops the arm
            text = self._bridge.failed(self._name, error)
            outcome = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, text)
        log_outcome(self._logger, outcome)
        if outcome.end is End.SUCCEEDED:
            ros_handle.succeed()
        elif outcome.end is End.CANCELED and ros_handle.status == GoalStatus.STATUS_CANCELING:
            ros_handle.canceled()
        else:
            ros_handle.abort()
        self._cancel_of.pop(key, None)
        return self._result(outcome)

    async def _outcome(
        self, key: bytes, ros_handle: ServerGoalHandle, plan: PlanningCancellation
    ) -> Outcome:
        if ros_handle.is_cancel_requested:
            return CANCELED
        done = self._bridge.create_future()
        try:
            handle = await self._prepare(ros_handle, plan, partial(self._bridge.resolve, done))
            if ros_handle.is_cancel_requested:
                return CANCELED
            self._cancel_of[key] = cancel = partial(self._queue.cancel, handle)
            self._bridge.hand_over(self._queue.submit, handle)
            if ros_handle.is_cancel_requested:
                self._bridge.to_loop(cancel)
            outcome: Outcome = await self._bridge.wait_for(done)
            return outcome
        finally:
            self._bridge.resolve(done, CANCELED)  # a rejected goal has no outcome

    def _cancel(self, ros_handle: ServerGoalHandle) -> CancelResponse:
        try:
            cancel = self._cancel_of.get(bytes(ros_handle.goal_id.uuid))
            if cancel is not None:
                self._bridge.to_loop(cancel)
        except DriverEndedError:
            return CancelResponse.REJECT
        except Exception as error:  # noqa: BLE001 - it is logged, answered, and stops the arm
            self._bridge.failed('canceling a goal', error)
            return CancelResponse.REJECT
        return CancelResponse.ACCEPT


def log_outcome(logger: RcutilsLogger, outcome: Outcome) -> None:
    text = outcome_line(outcome)
    if outcome.end is End.SUCCEEDED:  # two calls, because rclpy allows one severity per call
        logger.info(text)
    else:
        logger.warning(text)


def outcome_line(outcome: Outcome) -> str:
    end, text = outcome.end.value, outcome_text(outcome)
    return f'goal {text}' if text.startswith(end) else f'goal {end}: {text}'


@dataclass(frozen=True)
class NodeContext:
    driver: Driver
    setup: Setup
    bridge: LoopBridge

    @property
    def node(self) -> Node:
        return self.bridge.node

    @property
    def values(self) -> dict[str, Any]:
        return self.setup.values


def _call(function: Callable[..., object], arguments: tuple[object, ...]) -> None:
    try:
        function(*arguments)
    except Exception as error:  # noqa: BLE001 - it is reported
        report_error(f'{getattr(function, "__qualname__", function)} failed', error)


def _answering(service: Service, logger: RcutilsLogger) -> Callable[..., Any]:
    """Return a callback for one of rclpy's services that replies even if rclpy's callback raises.

    For example, rclpy's set_parameters raises ValueError if a peer sends an invalid type. Such an
    error does not affect the driver, so the arm is not stopped.
    """
    serve = service.callback

    def answer(request: Any, response: Any) -> Any:
        try:
            return serve(request, response)
        except Exception as error:  # noqa: BLE001 - it is logged and answered
            why = f'{service.service_name} failed: {type(error).__name__}: {error}'
            logger.error(why)
            response = service.srv_type.Response()
            result = SetParametersResult(
                reason=f'{why}. Earlier parameters of the request may be set'
            )
            if service.srv_type is SetParameters:
                response.results = [result] * len(request.parameters)
            elif service.srv_type is SetParametersAtomically:
                response.result = result
            return response

    return answer
