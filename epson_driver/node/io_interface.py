# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node's I/O: `~/io_states`, `~/read_io`, `~/write_io`, and the action `~/gripper_cmd`."""

import asyncio
import math
from array import array
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from typing import Any

from action_msgs.msg import GoalStatus
from control_msgs.action import GripperCommand
from control_msgs.msg import GripperCommand as Command
from epson_msgs.msg import IoPoint, IoRange, IoStates
from epson_msgs.srv import ReadIo, WriteIo
from rclpy.action import CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle

from epson_driver.driver.io.gripper import Gripper
from epson_driver.driver.io.gripper_wiring import GripperError, GripperState, GripperWiring
from epson_driver.driver.io.io_client import IoAnswer
from epson_driver.driver.io.points import IoUnavailableError
from epson_driver.node.loop_bridge import LATCHED, DriverEndedError, NodeContext
from epson_driver.simple_message import IoAddress, IoSetting


class IoInterface:
    def __init__(self, context: NodeContext) -> None:
        self._io = context.driver.io
        self._bridge = context.bridge
        self._clock = context.node.get_clock()
        self._states = context.node.create_publisher(IoStates, '~/io_states', LATCHED)
        self._io.on_states = self._publish
        self._bridge.create_service(ReadIo, '~/read_io', self._read)
        self._bridge.create_service(WriteIo, '~/write_io', self._write)

    def _publish(self) -> None:
        message = IoStates(valid=bool(self._io.states), message=self._io.reason)
        message.header.stamp = self._clock.now().to_msg()
        message.ranges = [
            IoRange(type=item.io_type, start=item.start, values=array('i', item.values))
            for item in self._io.states
        ]
        self._states.publish(message)

    async def _read(self, request: ReadIo.Request, response: ReadIo.Response) -> ReadIo.Response:
        addresses = [IoAddress(point.type, point.index) for point in request.points]
        return await self._serve(partial(self._io.read, addresses), request.points, response)

    async def _write(
        self, request: WriteIo.Request, response: WriteIo.Response
    ) -> WriteIo.Response:
        settings = [IoSetting(point.type, point.index, point.value) for point in request.points]
        return await self._serve(partial(self._io.write, settings), request.points, response)

    async def _serve(
        self,
        answering: Callable[[], Coroutine[Any, Any, list[IoAnswer]]],
        points: Sequence[IoPoint],
        response: ReadIo.Response | WriteIo.Response,
    ) -> ReadIo.Response | WriteIo.Response:
        try:
            answers = await self._bridge.in_loop(answering)
        except (IoUnavailableError, DriverEndedError) as error:
            response.success = False
            response.message = str(error)
            response.points = [
                IoPoint(type=point.type, index=point.index, message=str(error)) for point in points
            ]
            return response
        errors = [answer.text for answer in answers if answer.text]
        response.success = not errors
        response.message = errors[0] if errors else ''
        if len(errors) > 1:
            response.message += f' (and {len(errors) - 1} more)'
        response.points = [
            IoPoint(
                type=answer.io_type,
                index=answer.index,
                value=answer.value,
                result=answer.result,
                message=answer.text,
            )
            for answer in answers
        ]
        return response


def refusal(command: Command) -> str:
    if not math.isfinite(command.position):
        return f'position = {command.position}: must be finite'
    if not command.max_effort <= 0.0:
        return (
            f'max_effort = {command.max_effort:g}: must be 0 (no limit), because outputs set no '
            'force. Limit it at the gripper'
        )
    return ''


class GripperServer:
    """Serves the action `~/gripper_cmd` with a driver's I/O. Must be created in the driver's loop.

    The action's type is GripperCommand of control_msgs, which MoveIt's simple controller manager
    uses. Two outputs open and close the gripper. A goal position above half of the stroke opens
    the gripper, any other position closes it.
    """

    def __init__(self, context: NodeContext, wiring: GripperWiring) -> None:
        self._gripper = Gripper(context.driver.io, wiring)
        self._stroke = wiring.stroke
        self._bridge = context.bridge
        self._logger = context.node.get_logger()
        self._moves: dict[bytes, asyncio.Task[GripperState]] = {}
        self.action_server = context.bridge.create_action(
            GripperCommand,
            '~/gripper_cmd',
            self._execute,
            goal_callback=self._on_goal,
            cancel_callback=self._on_cancel,
        )

    # --- from ROS: these run in the executor's thread ---------------------------------------

    def _on_goal(self, goal: GripperCommand.Goal) -> GoalResponse:
        if not (why := refusal(goal.command)):
            return GoalResponse.ACCEPT
        self._logger.warning(f'~/gripper_cmd: {why}')
        return GoalResponse.REJECT

    def _on_cancel(self, ros_handle: ServerGoalHandle) -> CancelResponse:
        """Stop waiting for the gripper. The gripper's motion cannot be stopped."""
        try:
            self._bridge.to_loop(self._cancel_move, bytes(ros_handle.goal_id.uuid))
        except DriverEndedError:
            return CancelResponse.REJECT
        return CancelResponse.ACCEPT

    async def _execute(self, ros_handle: ServerGoalHandle) -> GripperCommand.Result:
        opened = ros_handle.request.command.position > self._stroke / 2
        key = bytes(ros_handle.goal_id.uuid)
        state: GripperState | None = None
        try:
            state = await self._bridge.in_loop(lambda: self._move(key, opened))
        except (GripperError, DriverEndedError) as error:
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
        """Return the ROS result for a state. The position is NaN if the state is unknown."""
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
            raise GripperError('canceled, the outputs stay unchanged')
        return task.result()

    def _cancel_move(self, key: bytes) -> None:
        if key in self._moves:
            self._moves[key].cancel()
