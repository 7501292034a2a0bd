# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The action `~/gripper_cmd` for a gripper that two outputs open and close.

It is control_msgs' GripperCommand, which MoveIt's simple controller manager calls. Such a gripper
has two positions: more than half of its stroke is open, anything else is closed.
"""

import asyncio
import math
from collections.abc import Mapping
from typing import Any

from action_msgs.msg import GoalStatus
from control_msgs.action import GripperCommand
from control_msgs.msg import GripperCommand as Command
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node

from epson_driver.driver.io.gripper import Gripper
from epson_driver.driver.io.gripper_wiring import GripperError, GripperState, GripperWiring
from epson_driver.driver.io.io_driver import Io
from epson_driver.inputs import InputError
from epson_driver.node.loop_bridge import REQUEST_QOS, DriverEndedError, LoopBridge

NOT_WIRED = [-1, -1]


def gripper_wiring(parameters: Mapping[str, Any]) -> GripperWiring | None:
    """Return how the node's parameters say that the gripper is wired, or None without one.

    Raises InputError, which names the parameters.
    """
    outputs, inputs = parameters['gripper.outputs'], parameters['gripper.inputs']
    if outputs == inputs == NOT_WIRED:
        return None
    try:
        return GripperWiring(
            open_output=outputs[0],
            close_output=outputs[1],
            opened_input=inputs[0],
            closed_input=inputs[1],
            stroke=parameters['gripper.stroke'],
            time=parameters['gripper.time'],
        )
    except ValueError as error:
        raise InputError(
            f'parameters gripper.outputs = {outputs}, gripper.inputs = {inputs}: {error}; '
            'both are needed for a gripper'
        ) from error


def refusal(command: Command) -> str:
    """Return why a command is refused, or ''."""
    if not math.isfinite(command.position):
        return f'position = {command.position}: must be finite'
    if not command.max_effort <= 0.0:
        return (
            f'max_effort = {command.max_effort:g}: must be 0 (no limit): outputs set no force, '
            'limit it at the gripper'
        )
    return ''


class GripperServer:
    """Serves the action over a driver's I/O. Make it in the driver's event loop."""

    def __init__(
        self,
        node: Node,
        io: Io,
        wiring: GripperWiring,
        bridge: LoopBridge,
        callback_group: CallbackGroup,
    ) -> None:
        self._gripper = Gripper(io, wiring)
        self._stroke = wiring.stroke
        self._bridge = bridge
        self._logger = node.get_logger()
        self._moves: dict[bytes, asyncio.Task[GripperState]] = {}
        self.action_server = ActionServer(
            node,
            GripperCommand,
            '~/gripper_cmd',
            self._execute,
            goal_callback=self._on_goal,
            cancel_callback=self._on_cancel,
            callback_group=callback_group,
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
        """End the wait for the gripper, which cannot be stopped."""
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
        """Return the result, whose position is not a number if no state is known."""
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
