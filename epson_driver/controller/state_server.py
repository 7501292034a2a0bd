# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state port and the I/O port: requests answered, and on the state port the state sent."""

import asyncio
import time
from itertools import cycle

from epson_driver.controller.connection import Connection
from epson_driver.controller.core import Controller
from epson_driver.controller.pacer import Pacer
from epson_driver.controller.port_server import PortServer
from epson_driver.controller.requests import Answers, answer_frame
from epson_driver.simple_message import Dialect, Framer, MessageType, encode, topic

MAX_CATCH_UP = 3
"""Periods that are made up for after a delay; what was missed before them is left out."""


class RequestServer(PortServer):
    """Answers requests. It has no message types of its own: the I/O port, for now."""

    name = 'io'

    def __init__(self, dialect: Dialect) -> None:
        super().__init__()
        self._dialect = dialect

    async def serve(self, connection: Connection) -> None:
        """Answer until the client is gone. Raises FrameError for bytes that are no messages."""
        framer = Framer(self._dialect.byte_order)
        while data := await connection.receive():
            framer.receive_data(data)
            while (frame := framer.next_frame()) is not None:
                reply = answer_frame(frame, self.answers())
                if reply is not None:
                    connection.send(encode(reply, self._dialect))

    def answers(self) -> Answers:
        """Return the answers to the port's own message types."""
        return {}


class StateServer(RequestServer):
    """Sends every client JOINT_POSITION each `period` s, and STATUS in every eleventh slot."""

    name = 'state'
    max_unsent = 4096  # a third of a second
    send_buffer = 16_384

    def __init__(self, pacer: Pacer, controller: Controller, period: float) -> None:
        super().__init__(controller.dialect)
        self._pacer = pacer
        self._period = period
        self._pattern = ('joint_position',) * controller.profile.joint_positions_per_status
        self._pattern += ('status',)

    async def serve(self, connection: Connection) -> None:
        """Send the state and answer requests; a client may shut its own side and still read."""
        stream = asyncio.create_task(self._stream(connection))
        try:
            await super().serve(connection)
            await stream
        finally:
            stream.cancel()

    def answers(self) -> Answers:
        """Return the answers to requests for what is sent anyway."""
        with self._pacer.present() as controller:
            return {
                MessageType.JOINT_POSITION: controller.joint_position,
                MessageType.STATUS: controller.status,
            }

    async def _stream(self, connection: Connection) -> None:
        due = time.monotonic()
        for slot in cycle(self._pattern):
            with self._pacer.present() as controller:
                message = getattr(controller, slot)()
            connection.send(encode(topic(message), self._dialect))
            if connection.closed:
                return
            due += self._period
            now = time.monotonic()
            if now - due > MAX_CATCH_UP * self._period:
                due = now
            await asyncio.sleep(due - now)
