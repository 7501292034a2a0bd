# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Listens to a port, and asks it: what came, when, and in which pieces. Nothing else."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    CommType,
    Dialect,
    Frame,
    FrameError,
    Framer,
    Message,
    Packet,
    SimpleMessageError,
    decode,
    encode,
    request,
)
from epson_driver.socket_errors import reason

CONNECT_TIMEOUT_S = 5.0
FRAME_HEADER_BYTES = 16
MAX_KEPT = 100_000
"""Packets that are kept: eight minutes at 200 Hz."""


class NoConnectionError(ConnectionError):
    """No connection; the text says why."""


@dataclass
class Heard:
    """What came over one connection. Times are s on the monotonic clock."""

    handshake: float
    """How long TCP's handshake took, s."""
    packets: list[tuple[float, Packet]] = field(default_factory=list)
    pieces: int = 0
    broken_pieces: int = 0
    """How many pieces of the stream there were, and how many ended within a message."""
    frames: int = 0
    unreadable: str = ''
    """What was wrong with the first bytes that were no message."""
    ended: str = ''
    """How the connection ended, if the controller ended it."""
    first_bytes: bytes = b''


class Conversation:
    """One connection to a port of the controller, while it lasts."""

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, handshake: float
    ) -> None:
        self.heard = Heard(handshake)
        self.dialect: Dialect = LITTLE_ENDIAN
        self._reader = reader
        self._writer = writer
        self._framer = Framer()
        self._bytes = self._framed = 0
        self._news = asyncio.Event()
        self._task = asyncio.create_task(self._read())

    async def ended_within(self, seconds: float) -> bool:
        """Wait for so long; return whether the controller closed the connection meanwhile."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(asyncio.shield(self._task), seconds)
        return self._task.done()

    async def next_packet(self, timeout: float, *, replies: bool = False) -> Packet | None:
        """Return the next packet that comes, or the next reply; None if none does in time."""
        begin = len(self.heard.packets)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                while True:
                    for _, packet in self.heard.packets[begin:]:
                        if not replies or packet.comm_type is CommType.SERVICE_REPLY:
                            return packet
                    begin = len(self.heard.packets)
                    if self._task.done():
                        return None
                    self._news.clear()
                    await self._news.wait()
        return None

    async def ask(self, message: Message, timeout: float) -> Packet | None:
        """Send a request and return the next reply; None if none comes in time, or ever."""
        if self._task.done():
            return None
        self._writer.write(encode(request(message), self.dialect))
        return await self.next_packet(timeout, replies=True)

    async def close(self) -> None:
        """Close the connection."""
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task
        self._writer.close()
        with contextlib.suppress(OSError, TimeoutError):
            await asyncio.wait_for(self._writer.wait_closed(), 1.0)

    async def _read(self) -> None:
        heard = self.heard
        try:
            while data := await self._reader.read(65536):
                now = asyncio.get_running_loop().time()
                if not heard.first_bytes:
                    heard.first_bytes = data[:64]
                if not heard.unreadable:
                    self._take(data, now)
                self._news.set()
            heard.ended = 'closed by the controller'
        except OSError as error:
            heard.ended = f'broken off: {reason(error)}'
        finally:
            self._news.set()

    def _take(self, data: bytes, now: float) -> None:
        heard = self.heard
        self._bytes += len(data)
        heard.pieces += 1
        self._framer.receive_data(data)
        try:
            while (frame := self._framer.next_frame()) is not None:
                self._framed += FRAME_HEADER_BYTES + len(frame.body)
                heard.frames += 1
                self._take_frame(frame, now)
        except FrameError as error:
            heard.unreadable = str(error)
        heard.broken_pieces += self._framed != self._bytes

    def _take_frame(self, frame: Frame, now: float) -> None:
        try:
            packet = decode(frame)
        except SimpleMessageError as error:
            self.heard.unreadable = str(error)
            return
        if len(self.heard.packets) < MAX_KEPT:
            self.heard.packets.append((now, packet))


@asynccontextmanager
async def conversation(host: str, port: int) -> AsyncIterator[Conversation]:
    """Connect to a port. Raises NoConnectionError that says why not."""
    began = asyncio.get_running_loop().time()
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            reader, writer = await asyncio.open_connection(host, port)
    except TimeoutError as error:
        raise NoConnectionError(f'no answer within {CONNECT_TIMEOUT_S:g} s') from error
    except (OSError, OverflowError, ValueError) as error:
        raise NoConnectionError(reason(error)) from error
    made = Conversation(reader, writer, asyncio.get_running_loop().time() - began)
    try:
        yield made
    finally:
        await made.close()
