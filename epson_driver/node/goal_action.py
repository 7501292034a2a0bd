# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An action whose goals are executed by a queue. Every request is accepted and ends once.

The parts that differ between actions are parameters: the conversion of a request to a goal, the
feedback and the result.
"""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from action_msgs.msg import GoalStatus
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.impl.rcutils_logger import RcutilsLogger

from epson_driver.driver.goal.planning_scope import PlanningScope
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.node.loop_bridge import REQUEST_QOS, DriverEndedError, LoopBridge
from epson_driver.node.remedies import outcome_text

CANCELED = Outcome(End.CANCELED, ErrorCode.SUCCESSFUL, 'canceled before it could start')


class Queue(Protocol):
    """Interface of a queue of goals. Its methods are called in the loop."""

    def submit(self, handle: Any) -> None:
        """Execute a goal, which reports its end."""

    def cancel(self, handle: Any) -> None:
        """End a submitted goal."""


OnEnd = Callable[[Outcome], None]


@dataclass(frozen=True, eq=False)
class ActionType:
    """The parts that differ between actions.

    kind: the ROS type. name: for example `~/follow_joint_trajectory`. prepare: reads and checks a
    request in the executor. It returns a function from the callback for the outcome to a goal for
    the queue, and may raise GoalRejectedError. Its planning scope ends when the goal is canceled,
    which interrupts long planning. result: converts an outcome to the action's result.
    result_timeout: time for which a result is stored for late requests, s.
    """

    kind: Any
    name: str
    prepare: Callable[[ServerGoalHandle, PlanningScope], Awaitable[Callable[[OnEnd], Any]]]
    result: Callable[[Outcome], Any]
    result_timeout: int


@dataclass(eq=False)
class _Request:
    """A goal without a result. handle: None during preparation."""

    plan: PlanningScope
    handle: Any = None


class GoalAction:
    """Serves an action over a queue of goals."""

    def __init__(self, action: ActionType, queue: Queue, bridge: LoopBridge) -> None:
        self._logger = bridge.node.get_logger()
        self._action = action
        self._queue = queue
        self._bridge = bridge
        self._requests: dict[bytes, _Request] = {}
        """Goals without a result, by id."""
        self.server = ActionServer(
            bridge.node,
            action.kind,
            action.name,
            self._execute,
            goal_callback=lambda goal: GoalResponse.ACCEPT,  # a rejected one needs a result
            cancel_callback=self._cancel,
            callback_group=bridge.group,
            goal_service_qos_profile=REQUEST_QOS,
            result_service_qos_profile=REQUEST_QOS,
            cancel_service_qos_profile=REQUEST_QOS,
            result_timeout=action.result_timeout,
        )

    @property
    def busy(self) -> bool:
        """True while a goal has no result."""
        return bool(self._requests)

    async def _execute(self, ros_handle: ServerGoalHandle) -> Any:
        """Pass a goal to the driver and wait for its outcome."""
        key = bytes(ros_handle.goal_id.uuid)
        self._requests[key] = request = _Request(PlanningScope())
        try:
            outcome = await self._outcome(request, ros_handle)
        except GoalRejectedError as rejection:
            outcome = CANCELED if ros_handle.is_cancel_requested else rejection.outcome
        except DriverEndedError as error:
            outcome = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, str(error))
        except Exception as error:  # noqa: BLE001 - it is logged, answered, and stops the arm
            text = self._bridge.failed(self._action.name, error)
            outcome = Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, text)
        log_outcome(self._logger, outcome)
        if outcome.end is End.SUCCEEDED:
            ros_handle.succeed()
        elif outcome.end is End.CANCELED and ros_handle.status == GoalStatus.STATUS_CANCELING:
            ros_handle.canceled()
        else:
            ros_handle.abort()
        self._requests.pop(key, None)
        return self._action.result(outcome)

    async def _outcome(self, request: _Request, ros_handle: ServerGoalHandle) -> Outcome:
        """Return how a goal ended. Raises GoalRejectedError, DriverEndedError."""
        if ros_handle.is_cancel_requested:
            return CANCELED
        prepared = await self._action.prepare(ros_handle, request.plan)
        if ros_handle.is_cancel_requested:
            return CANCELED
        done = self._bridge.create_future()
        handle = request.handle = prepared(partial(self._bridge.resolve, done))
        self._bridge.hand_over(self._queue.submit, handle)
        if ros_handle.is_cancel_requested:
            self._bridge.to_loop(self._queue.cancel, handle)
        outcome: Outcome = await self._bridge.wait_for(done)
        return outcome

    def _cancel(self, ros_handle: ServerGoalHandle) -> CancelResponse:
        try:
            request = self._requests.get(bytes(ros_handle.goal_id.uuid))
            if request is not None and request.handle is not None:
                self._bridge.to_loop(self._queue.cancel, request.handle)
            elif request is not None:
                self._bridge.to_loop(request.plan.end, CANCELED.text)
        except DriverEndedError:
            return CancelResponse.REJECT
        except Exception as error:  # noqa: BLE001 - it is logged, answered, and stops the arm
            self._bridge.failed('canceling a goal', error)
            return CancelResponse.REJECT
        return CancelResponse.ACCEPT


def log_outcome(logger: RcutilsLogger, outcome: Outcome) -> None:
    """Log how a goal ended."""
    text = outcome_line(outcome)
    if outcome.end is End.SUCCEEDED:  # a line each: rclpy allows a line one severity
        logger.info(text)
    else:
        logger.warning(text)


def outcome_line(outcome: Outcome) -> str:
    """Return a log line for the end of a goal, without repeating "canceled"."""
    end, text = outcome.end.value, outcome_text(outcome)
    return f'goal {text}' if text.startswith(end) else f'goal {end}: {text}'
