# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The client's side of Real-time Motion Control: requests with their replies, and targets."""

import asyncio
from collections import deque
from collections.abc import Callable
from operator import truediv

import numpy as np

from epson_driver.motion import Array
from epson_driver.rtmc.conditions import sentence
from epson_driver.rtmc.messages import (
    JOINTS,
    MOVED_DATA,
    REPLY_DATA,
    Request,
    RtmcError,
    RtmcMessage,
    decode,
)
from epson_driver.rtmc.transport import Transport

MM_PER_M = 1000.0


class RefusedError(Exception):
    """A request was refused. The text contains the reason and the remedy."""

    def __init__(self, reply: RtmcMessage) -> None:
        super().__init__(sentence(reply.number, reply.low))
        self.low = reply.low


class RtmcSession:
    """Requests to one controller, and the ring of targets (`Ring`).

    * `on_notice(message)`: called with each notice.
    * `on_moved(positions, full, time)`: called with the joints of each accepted target, rad or m,
      whether the buffer of the controller was full, and the time of the reply, s.
    * `on_refused(text)`: called if a target is refused. The motion is over.
    """

    def __init__(
        self,
        transport: Transport,
        units: tuple[str, ...],
        on_notice: Callable[[RtmcMessage], None],
        on_moved: Callable[[tuple[float, ...], bool, float], None],
        on_refused: Callable[[str], None],
    ) -> None:
        self._transport = transport
        self._on_notice = on_notice
        self._on_moved = on_moved
        self._on_refused = on_refused
        self._scales = [MM_PER_M if unit == 'm' else 1.0 for unit in units]
        self._pending: deque[tuple[int, asyncio.Future[RtmcMessage]]] = deque()
        self._moved = False

    def request(self, message: RtmcMessage) -> asyncio.Future[RtmcMessage]:
        """Send a request after the replies to all earlier requests, and return its pending reply.

        Raises ConnectionError if no controller is connected, or TransportError. The reply raises
        RefusedError.
        """
        if not self._transport.request(message.encode()):
            raise ConnectionError('the controller has left')
        reply: asyncio.Future[RtmcMessage] = asyncio.get_running_loop().create_future()
        self._pending.append((message.number, reply))
        return reply

    def receive(self, data: bytes, time: float) -> None:
        """Process a message. Raises RtmcError if it is invalid or unexpected."""
        message = decode(data)
        number = message.number
        if number in (Request.STATUS_NOTICE, Request.JOINTS_NOTICE):
            self._on_notice(message)
            return
        if number == Request.MOVE and self._moved:
            if message.high:
                full, *joints = message.values(MOVED_DATA)[:-1]
                self._on_moved(self.positions(joints), bool(full), time)
            else:
                self._on_refused(sentence(number, message.low))
            return
        if not self._pending or self._pending[0][0] != number:
            raise RtmcError(f'message {number} is not the reply to the request')
        if message.high and (layout := REPLY_DATA.get(number)):
            message.values(layout)
        _, reply = self._pending.popleft()
        if reply.cancelled():
            return
        if message.high:
            reply.set_result(message)
        else:
            reply.set_exception(RefusedError(message))

    def positions(self, values: 'tuple[float, ...] | list[float]') -> tuple[float, ...]:
        """Convert the joint values of a message to the robot's joint positions, rad or m."""
        return tuple(map(truediv, values, self._scales))

    # Targets.

    def start(self, position: Array) -> None:
        """Hold the arm at its position, shape (n,). The motion mode must be enabled."""
        self._moved = True
        self._transport.start(self._targets(position[None, :]))

    def end(self) -> None:
        """Stop sending targets."""
        self._transport.end()

    @property
    def taken(self) -> int:
        return self._transport.taken

    def replace(self, first: int, targets: Array, planned: int) -> bool:
        return self._transport.replace(first, self._targets(targets), planned)

    def _targets(self, positions: Array) -> Array:
        count = len(self._scales)
        targets = np.zeros((len(positions), JOINTS))
        targets[:, :count] = positions.reshape(-1, count) * self._scales
        return targets
