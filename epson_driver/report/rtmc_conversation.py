# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Converts recorded messages of Real-time Motion Control to simple messages, which a report reads.

A target becomes a point of a trajectory at the time at which it was sent. The targets that hold
the arm before, between and after the motions are omitted.
"""

from collections.abc import Iterator

from epson_driver.rtmc.messages import (
    JOINTS_DATA,
    MOVED_DATA,
    TARGET_DATA,
    Request,
    RtmcMessage,
    RtmcStatus,
)
from epson_driver.rtmc.session import MM_PER_M
from epson_driver.simple_message import (
    JointPosition,
    JointTrajPtFull,
    Message,
    MotionCtrl,
    ValidFields,
    joint_data,
)
from epson_driver.simple_message.motoman import Command

POINT = ValidFields.TIME | ValidFields.POSITION
REST_S = 0.05  # rest of the arm after which a new trajectory starts, s
JOINTS = (Request.JOINTS, Request.JOINTS_NOTICE, Request.JOINTS_AT_REST)


class RtmcConversation:
    """Converts the messages of one connection. `units`: unit of each joint, `rad` or `m`."""

    def __init__(self, units: tuple[str, ...]) -> None:
        self._scales = [MM_PER_M if unit == 'm' else 1.0 for unit in units]
        self._powered: bool | None = None
        self._moving = False
        self._status: RtmcStatus | None = None
        self._last: tuple[float, tuple[float, ...]] | None = None  # time and joints of a target
        self._moved = 0.0  # time of the last target that moved the arm, s
        self._begun = 0.0  # time of the first point, s
        self._points = 0

    def sent(self, message: RtmcMessage, time: float) -> Iterator[Message]:
        """Yield simple message requests equivalent to the driver's message at `time`, s.

        Raises RtmcError if the message is not valid.
        """
        if message.number == Request.MOVE:
            yield from self._target(message, time)
        elif message.number == Request.SET_MODE:
            self._moving, self._last, self._moved = bool(message.low), None, 0.0
        elif message.number == Request.SET_MOTORS:
            command = Command.START_SERVOS if message.low else Command.STOP_SERVOS
            yield MotionCtrl(0, 0, command)
        elif message.number == Request.RESET:
            yield MotionCtrl(0, 0, Command.RESET_ALARM)

    def received(self, message: RtmcMessage) -> Iterator[Message]:
        """Yield simple message topics equivalent to a controller's message.

        Raises RtmcError if invalid.
        """
        number = message.number
        if number == Request.MOVE:
            yield JointPosition(0, self._positions(message.values(MOVED_DATA)[1:-1]))
        elif number in JOINTS:
            yield JointPosition(0, self._positions(message.values(JOINTS_DATA)))
        elif number in (Request.STATUS, Request.STATUS_NOTICE):
            self._status = RtmcStatus.decode(message)
            if self._status.estop:
                self._powered = False
        elif number == Request.MOTORS:
            self._powered = bool(message.low)
        if self._status is not None and number not in (Request.MOVE, *JOINTS):
            yield self._status.simple_status(self._powered, in_motion=self._moving)

    def _target(self, message: RtmcMessage, time: float) -> Iterator[Message]:
        positions = self._positions(message.values(TARGET_DATA)[:-1])
        last, self._last = self._last, (time, positions)
        if last is None or positions == last[1]:
            return
        if time - self._moved > REST_S:
            self._points = 0
        if last[0] != self._moved:
            yield self._point(*last)
        yield self._point(time, positions)
        self._moved = time

    def _point(self, time: float, positions: tuple[float, ...]) -> Message:
        if not self._points:
            self._begun = time
        self._points += 1
        return JointTrajPtFull(0, self._points - 1, POINT, time - self._begun, positions)

    def _positions(self, values: tuple[float, ...]) -> tuple[float, ...]:
        return joint_data(
            [value / scale for value, scale in zip(values, self._scales, strict=False)]
        )
