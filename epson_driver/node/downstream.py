# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Access to another driver: its FollowJointTrajectory action and its joint states.

The caller runs in an event loop, but all calls of rclpy run in the thread of rclpy's executor.
The reason is that rclpy's action client registers a request only after sending it. In another
thread, a reply could be processed before the request is registered, and be lost.
"""

import asyncio
import logging
from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from rclpy.action import ActionClient
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.task import Future
from sensor_msgs.msg import JointState

from epson_driver.driver.outcome import End, ErrorCode, Outcome
from epson_driver.driver.tasks import report_error
from epson_driver.motion import Array, JointLimits
from epson_driver.node.joint_reader import JointReader
from epson_driver.node.trajectory_messages import invalid_goal

QUERY = 'query_state'
"""Service that identifies a joint_trajectory_controller or a class derived from it."""

OWN_TOPIC_S = 1.0
"""Maximum time between the discovery of the driver's action and of its `controller_state`, s."""

_log = logging.getLogger(__name__)


class Downstream:
    def __init__(self, node: Node, action: str, callback_group: CallbackGroup) -> None:
        self._node = node
        self._loop = asyncio.get_running_loop()
        self.name: str = node.resolve_topic_name(action)
        self._client = ActionClient(
            node, FollowJointTrajectory, self.name, callback_group=callback_group
        )

    @property
    def available(self) -> bool:
        return bool(self._client.server_is_ready())

    @property
    def no_server(self) -> str:
        return f'no server for the action {self.name}: start its driver'

    @property
    def keeps_stamps(self) -> bool:
        """Whether the server is a joint_trajectory_controller, which obeys `header.stamp`."""
        service = f'{self.name.rpartition("/")[0]}/{QUERY}'
        return service in dict(self._node.get_service_names_and_types())

    async def send(
        self,
        goal: FollowJointTrajectory.Goal,
        on_feedback: Callable[[FollowJointTrajectory.Feedback], None],
        timeout: float,
    ) -> 'Sent':
        """Send a goal, and return it once it is accepted.

        `on_feedback` is called in the executor's thread. Raises GoalRejectedError if the goal is
        rejected, or not answered within `timeout` s. A goal that is accepted later is canceled.
        """
        if not self.available:
            raise invalid_goal(self.no_server)
        reply = self._loop.create_task(
            self.request_result(
                lambda: self._client.send_goal_async(
                    goal, lambda message: on_feedback(message.feedback)
                )
            )
        )
        done, _ = await asyncio.wait({reply}, timeout=timeout)
        if not done:
            reply.add_done_callback(self._cancel_late)
            raise invalid_goal(
                f'{self.name} did not reply within {timeout:g} s. A later acceptance '
                'will be canceled',
            )
        handle = reply.result()
        if not handle.accepted:
            raise invalid_goal(
                f'{self.name} rejected the smooth trajectory: see its log',
            )
        return Sent(self, handle)

    async def request_result(self, request: Callable[[], Any]) -> Any:
        done: asyncio.Future[Any] = self._loop.create_future()

        def on_done(future: Any) -> None:
            self._loop.call_soon_threadsafe(_copy_result, done, future)

        def start() -> None:
            try:
                future = request()
            except Exception as error:  # noqa: BLE001 - it is raised in the caller
                future = Future()
                future.set_exception(error)
            future.add_done_callback(on_done)

        self._node.executor.create_task(start)
        return await done

    def _cancel_late(self, reply: 'asyncio.Task[Any]') -> None:
        if reply.cancelled():
            return
        if (error := reply.exception()) is not None:
            report_error('sending a goal failed', error)
        elif reply.result().accepted:
            _log.error('%s accepted a goal too late, so it is canceled', self.name)
            self._loop.create_task(self.request_result(reply.result().cancel_goal_async))


class Sent:
    """An accepted goal. `result` is a task that returns the goal's outcome.

    If the server ends without sending a result, the task does not end.
    """

    def __init__(self, downstream: Downstream, handle: Any) -> None:
        self._downstream = downstream
        self._handle = handle
        self.result = asyncio.create_task(self._result())

    async def _result(self) -> Outcome:
        reply = await self._downstream.request_result(self._handle.get_result_async)
        code, text = reply.result.error_code, reply.result.error_string
        ended = End.SUCCEEDED if reply.status == GoalStatus.STATUS_SUCCEEDED else End.ABORTED
        if code not in map(int, ErrorCode):
            text, code = f'{text} (error code {code})', ErrorCode.INVALID_GOAL
        if ended is End.ABORTED:
            how = 'canceled' if reply.status == GoalStatus.STATUS_CANCELED else 'ended'
            text = f'{self._downstream.name} {how} the goal: {text or "without a reason"}'
        return Outcome(ended, ErrorCode(code), text)

    async def cancel(self, timeout: float) -> bool:
        try:
            async with asyncio.timeout(timeout):
                await self._downstream.request_result(self._handle.cancel_goal_async)
                await asyncio.shield(self.result)
        except TimeoutError:
            return False
        return True


class ArmState:
    """Joint state from the driver's `controller_state`, or else from `joint_states`.

    Other nodes may publish on `joint_states`. This topic is therefore used only if
    `controller_state` has not been discovered OWN_TOPIC_S after the driver's action.
    """

    def __init__(self, node: Node, downstream: Downstream, callback_group: CallbackGroup) -> None:
        self._loop = asyncio.get_running_loop()
        self._node = node
        self._downstream = downstream
        self._without_own_since: float | None = None
        self._own = JointReader(f'{downstream.name.rpartition("/")[0]}/controller_state')
        self._shared = JointReader('joint_states')
        for kind, topic, callback in (
            (JointTrajectoryControllerState, self._own.topic, self._on_own),
            (JointState, self._shared.topic, self._on_shared),
        ):
            node.create_subscription(
                kind, topic, callback, qos_profile_sensor_data, callback_group=callback_group
            )

    def _on_own(self, message: JointTrajectoryControllerState) -> None:
        now, feedback = self._loop.time(), message.feedback
        stamp = message.header.stamp
        self._own.take(message.joint_names, feedback.positions, feedback.velocities, stamp, now)

    def _on_shared(self, message: JointState) -> None:
        now, stamp = self._loop.time(), message.header.stamp
        self._shared.take(message.name, message.position, message.velocity, stamp, now)

    def of(self, limits: JointLimits, oldest: float) -> tuple[Array, Array]:
        """Return positions and velocities, shapes (n,).

        Raises GoalRejectedError like JointReader.of, and before one of the topics has been chosen.
        """
        now, reader = self._loop.time(), self._own
        if not (self._own or self._node.count_publishers(self._own.topic)):
            if self._without_own_since is None and self._downstream.available:
                self._without_own_since = now
            if self._without_own_since is None or now - self._without_own_since < OWN_TOPIC_S:
                raise invalid_goal(f'no publisher of {self._own.topic} has been found yet')
            reader = self._shared
        return reader.of(limits.names, limits.velocity, oldest, now)


def _copy_result(done: 'asyncio.Future[Any]', future: Any) -> None:
    if done.done():
        return
    if (error := future.exception()) is not None:
        done.set_exception(error)
    else:
        done.set_result(future.result())
