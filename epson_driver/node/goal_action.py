# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Server of a ROS action whose goals are executed by a queue, and conversion of goal requests.

Every request is accepted and ends exactly once. Invalid goals end with an error code and a reason.
"""

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock
from rclpy.impl.rcutils_logger import RcutilsLogger

from epson_driver.driver.goal.goal import Goal, Tolerances, untimed
from epson_driver.driver.goal.planning_scope import PlanningScope
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.node.loop_bridge import REQUEST_QOS, DriverEndedError, LoopBridge
from epson_driver.node.messages import outcome_text
from epson_driver.node.trajectory_messages import (
    duration_in_s,
    tolerances_from_messages,
    trajectory_from_message,
)
from epson_driver.setup.setup import Setup

MAX_START_OFFSET_S = 1.0
"""Maximum time from now to the start time of a goal, s, in the past and in the future. A goal
outside this range is rejected, because the arm would move unexpectedly."""

UNSUPPORTED = ('multi_dof_trajectory', 'component_path_tolerance', 'component_goal_tolerance')
"""Fields of a goal for joints with several degrees of freedom, which must be empty."""

EMPTY = FollowJointTrajectory.Goal()


class GoalRequests:
    """Converts FollowJointTrajectory requests to goals, using the current parameters.

    * clock: the node's ROS clock.
    * loop_time: returns the time of the driver's event loop, s.
    """

    def __init__(self, setup: Setup, clock: Clock, loop_time: Callable[[], float]) -> None:
        self._limits = setup.model.limits
        self._setup = setup
        self._clock = clock
        self._loop_time = loop_time

    def checked_goal(self, request: FollowJointTrajectory.Goal) -> Goal:
        """Return the goal of a request. The queue checks the joint limits later.

        Raises GoalRejectedError if a name, a stamp or a tolerance is invalid.
        """
        check_unsupported(request)
        trajectory = trajectory_from_message(request.trajectory, self._limits.names)
        if self._setup.values['timing'] == 'time_optimal':
            trajectory = untimed(trajectory, self._limits)
        stamp = request.trajectory.header.stamp
        start = start_time(stamp, trajectory.duration, self._clock, self._loop_time)
        defaults = self._setup.goal(trajectory)
        path = self._tolerances(request.path_tolerance, 'path_tolerance', 'trajectory')
        goal = self._tolerances(request.goal_tolerance, 'goal_tolerance', 'goal')
        goal_time = duration_in_s(request.goal_time_tolerance)
        return replace(
            defaults,
            goal_tolerance=goal.position,
            goal_time=max(goal_time, 0.0) if goal_time != 0.0 else defaults.goal_time,
            goal_velocity=goal.velocity,
            path_tolerance=path if path.checked else None,
            start=start,
        )

    def _tolerances(self, messages: Sequence[JointTolerance], field: str, kind: str) -> Tolerances:
        """Return the tolerances of a goal, by default those in `constraints.<joint>.<kind>`."""
        defaults = self._setup.tolerances(kind).position
        return tolerances_from_messages(messages, field, self._limits.names, defaults)


def check_unsupported(request: FollowJointTrajectory.Goal) -> None:
    """Raise GoalRejectedError if an unsupported field is not empty."""
    for field in UNSUPPORTED:
        if getattr(request, field) != getattr(EMPTY, field):
            raise GoalRejectedError(
                ErrorCode.INVALID_GOAL,
                f'{field} must be empty: joints with several degrees of freedom are not supported',
            )


def start_time(
    stamp: Time, duration: float, clock: Clock, loop_time: Callable[[], float]
) -> float:
    """Return the start time of a trajectory on the loop's clock, s, or 0 to start immediately.

    `duration`: duration of the trajectory, s. Raises GoalRejectedError if `stamp` is more than
    MAX_START_OFFSET_S from now, or if the trajectory would already have ended.
    """
    if stamp == Time():
        return 0.0
    ahead: float = (stamp.sec * 10**9 + stamp.nanosec - clock.now().nanoseconds) * 1e-9
    oldest = min(duration, MAX_START_OFFSET_S)
    if -ahead > oldest:
        raise GoalRejectedError(
            ErrorCode.OLD_HEADER_TIMESTAMP,
            f'header.stamp is {-ahead:.3g} s ago: must be at most {oldest:.3g} s, by the clock of '
            'the driver (0 starts immediately)',
        )
    if ahead > MAX_START_OFFSET_S:
        raise GoalRejectedError(
            ErrorCode.INVALID_GOAL,
            f'header.stamp is {ahead:.3g} s in the future: must be at most '
            f'{MAX_START_OFFSET_S:g} s, by the clock of the driver',
        )
    return loop_time() + ahead


CANCELED = Outcome(End.CANCELED, ErrorCode.SUCCESSFUL, 'canceled before it could start')


class Queue(Protocol):
    """Interface of a queue of goals. Its methods are called in the driver's event loop."""

    def submit(self, handle: Any) -> None:
        """Execute a goal, and report its outcome to the handle."""

    def cancel(self, handle: Any) -> None:
        """Cancel a submitted goal."""


OnEnd = Callable[[Outcome], None]


@dataclass(frozen=True, eq=False)
class ActionType:
    """The parts that differ between actions.

    * kind: the ROS type of the action.
    * name: for example `~/follow_joint_trajectory`.
    * prepare: checks a request and plans the goal. Its result is a function that takes the
      callback for the outcome and returns the goal for the queue. It runs in the executor, and may
      raise GoalRejectedError. Canceling the goal ends the PlanningScope, which interrupts the
      planning.
    * result: converts an outcome to the action's result.
    * result_timeout: time for which a result is stored for late requests, s.
    """

    kind: Any
    name: str
    prepare: Callable[[ServerGoalHandle, PlanningScope], Awaitable[Callable[[OnEnd], Any]]]
    result: Callable[[Outcome], Any]
    result_timeout: int


@dataclass(eq=False)
class _Request:
    """A goal without a result. `handle`: the goal for the queue, or None until `prepare` ends."""

    plan: PlanningScope
    handle: Any = None


class GoalAction:
    """Serves an action whose goals a queue executes."""

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
            goal_callback=lambda goal: GoalResponse.ACCEPT,  # only accepted goals have a result
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
    """Log the end of a goal."""
    text = outcome_line(outcome)
    if outcome.end is End.SUCCEEDED:  # two calls, because rclpy allows one severity per call
        logger.info(text)
    else:
        logger.warning(text)


def outcome_line(outcome: Outcome) -> str:
    """Return a log line for the end of a goal, without repeating "canceled"."""
    end, text = outcome.end.value, outcome_text(outcome)
    return f'goal {text}' if text.startswith(end) else f'goal {end}: {text}'
