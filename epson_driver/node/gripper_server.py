# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The action `~/gripper_cmd` for a gripper that is opened and closed by two outputs.

It has the type GripperCommand of control_msgs, which MoveIt's simple controller manager uses. Such
a gripper has two positions: a position above half of its stroke opens it, others close it.
"""

import asyncio
import math

from action_msgs.msg import GoalStatus
from control_msgs.action import GripperCommand
from control_msgs.msg import GripperCommand as Command
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle

from epson_driver.driver.io.gripper import Gripper
from epson_driver.driver.io.gripper_wiring import GripperError, GripperState, GripperWiring
from epson_driver.node.loop_bridge import REQUEST_QOS, DriverEndedError, NodeContext


def refusal(command: Command) -> str:
    """Return why a command is rejected, or ''."""
    if not math.isfinite(command.position):
        return f'position = {command.position}: must be finite'
    if not command.max_effort <= 0.0:
        return (
            f'max_effort = {command.max_effort:g}: must be 0 (no limit): outputs set no force, '
            'limit it at the gripper'
        )
    return ''


class GripperServer:
    """Serves the action over a driver's I/O. Must be created in the driver's event loop."""

    def __init__(self, context: NodeContext, wiring: GripperWiring) -> None:
        self._gripper = Gripper(context.driver.io, wiring)
        self._stroke = wiring.stroke
        self._bridge = context.bridge
        self._logger = context.node.get_logger()
        self._moves: dict[bytes, asyncio.Task[GripperState]] = {}
        self.action_server = ActionServer(
            context.node,
            GripperCommand,
            '~/gripper_cmd',
            self._execute,
            goal_callback=self._on_goal,
            cancel_callback=self._on_cancel,
            callback_group=context.bridge.group,
            goal_service_qos_profile=REQUEST_QOS,
            result_service_qos_profile=REQUEST_QOS,
            cancel_service_qos_profile=REQUEST_QOS,
        )

    # --- from ROS: these run in the executor's thread ---------------------------------------

    def _on_goal(self, goal: GripperCommand.Goal) -> GoalResponse:
        if not (why := refusal(goal.command)):
            return GoalResponse.ACCEPT
        self._logger.warning(f'~/gripper_cmd: {why}')
        return GoalResponse.REJECT

    def _on_cancel(self, ros_handle: ServerGoalHandle) -> CancelResponse:
        """End the wait for the gripper. The gripper itself cannot be stopped."""
        try:
            self._bridge.to_loop(self._give_up, bytes(ros_handle.goal_id.uuid))
        except DriverEndedError:
            return CancelResponse.REJECT
        return CancelResponse.ACCEPT

    async def _execute(self, ros_handle: ServerGoalHandle) -> GripperCommand.Result:
        opened = ros_handle.request.command.position > self._stroke / 2
        key = bytes(ros_handle.goal_id.uuid)
        state: GripperState | None = None
        try:
            state = await self._bridge.in_loop(lambda: self._move(key, opened))
        except GripperError as error:
            self._logger.warning(f'~/gripper_cmd: {error}')
        except DriverEndedError as error:
            self._logger.warning(f'~/gripper_cmd: {error}')
        except Exception as error:  # noqa: BLE001 - it is logged, answered, and stops the arm
            self._bridge.failed('~/gripper_cmd', error)
        if state is not None:
            ros_handle.succeed()
        elif ros_handle.status == GoalStatus.STATUS_CANCELING:
            ros_handle.canceled()
        else:
            ros_handle.abort()
        return self._result(state, opened)

    def _result(self, state: GripperState | None, opened: bool) -> GripperCommand.Result:
        """Return the result. Its position is NaN if the state is unknown."""
        if state is None:
            return GripperCommand.Result(position=math.nan)
        reached = state.opened if opened else state.closed
        return GripperCommand.Result(
            position=state.position(self._stroke), stalled=not reached, reached_goal=reached
        )

    # --- in the loop ------------------------------------------------------------------------

    async def _move(self, key: bytes, opened: bool) -> GripperState:
        task = asyncio.create_task(self._gripper.move(opened=opened))
        self._moves[key] = task
        try:
            await asyncio.wait([task])
        finally:
            del self._moves[key]
            task.cancel()
        if task.cancelled():
            raise GripperError('canceled; the outputs stay as they are')
        return task.result()

    def _give_up(self, key: bytes) -> None:
        if key in self._moves:
            self._moves[key].cancel()
