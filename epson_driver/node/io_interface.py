# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node's I/O: `~/io_states`, `~/read_io` and `~/write_io` over the driver's I/O."""

from array import array
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from typing import Any

from epson_msgs.msg import IoPoint, IoRange, IoStates
from epson_msgs.srv import ReadIo, WriteIo
from rclpy.qos import DurabilityPolicy, QoSProfile

from epson_driver.driver.io.io_client import IoAnswer
from epson_driver.driver.io.points import IoUnavailableError
from epson_driver.node.loop_bridge import DriverEndedError, NodeContext
from epson_driver.simple_message import IoAddress, IoSetting


class IoInterface:
    """Publishes the I/O states and serves requests. Must be created in the driver's loop."""

    def __init__(self, context: NodeContext) -> None:
        self._io = context.driver.io
        self._bridge = context.bridge
        self._clock = context.node.get_clock()
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._states = context.node.create_publisher(IoStates, '~/io_states', latched)
        self._io.on_states = self._publish
        for kind, name, serve in (
            (ReadIo, '~/read_io', self._read),
            (WriteIo, '~/write_io', self._write),
        ):
            self._bridge.create_service(kind, name, serve)

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
        asked: Sequence[IoPoint],
        response: ReadIo.Response | WriteIo.Response,
    ) -> ReadIo.Response | WriteIo.Response:
        try:
            answers = await self._bridge.in_loop(answering)
        except (IoUnavailableError, DriverEndedError) as error:
            response.success = False
            response.message = str(error)
            response.points = [
                IoPoint(type=point.type, index=point.index, message=str(error)) for point in asked
            ]
            return response
        wrong = [answer.text for answer in answers if answer.text]
        response.success = not wrong
        response.message = wrong[0] if wrong else ''
        if len(wrong) > 1:
            response.message += f' (and {len(wrong) - 1} more)'
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
