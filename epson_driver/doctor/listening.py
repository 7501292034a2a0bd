# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A connection to a port that records each message with its time, and can send requests."""

import asyncio
import contextlib
import errno
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from enum import Enum, auto

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
from epson_driver.trace.pcap import Conversation as WireTrace
from epson_driver.trace.pcap import PcapWriter

CONNECT_TIMEOUT_S = 5.0
MAX_KEPT = 100_000
"""Maximum number of packets stored: eight minutes at 200 Hz."""


PROBES = {
    socket.SO_KEEPALIVE: (socket.SOL_SOCKET, 1),
    socket.TCP_KEEPIDLE: (socket.IPPROTO_TCP, 1),
    socket.TCP_KEEPINTVL: (socket.IPPROTO_TCP, 1),
    socket.TCP_KEEPCNT: (socket.IPPROTO_TCP, 2),
}
"""TCP probes a silent peer after 1 s and drops it 2 s later. No byte of data is sent for this."""

TRACE: ContextVar[PcapWriter | None] = ContextVar('trace', default=None)
"""Recorder of all bytes sent and received, or None."""

TICK_S = 0.02
"""Period of measuring this process's own lateness, s."""


class Refusal(Enum):
    """Kinds of failed connections."""

    UNKNOWN_NAME = auto()
    REFUSED = auto()
    DROPPED = auto()
    UNREACHABLE = auto()


class NoConnectionError(ConnectionError):
    """The connection failed, for the reason in the text and of the kind `refusal`."""

    def __init__(self, text: str, refusal: Refusal) -> None:
        super().__init__(text)
        self.refusal = refusal


@dataclass
class ReceivedTraffic:
    """The data received over one connection. Times are s on the monotonic clock."""

    handshake: float
    """Duration of TCP's handshake, s."""
    packets: list[tuple[float, Packet]] = field(default_factory=list)
    frames: int = 0
    unreadable: str = ''
    """Error text for the first bytes that were no message, or ''."""
    ended: str = ''
    """Reason for the end of the connection, or '' while it is open."""
    vanished: bool = False
    """Whether the connection was lost because the other machine stopped answering TCP."""
    first_bytes: bytes = b''
    lateness: float = 0.0
    """Maximum delay of a timer in this process, s: the uncertainty of its times."""


class Conversation:
    """One open connection to a port of the controller."""

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, handshake: float
    ) -> None:
        self.heard = ReceivedTraffic(handshake)
        peer, own = (writer.get_extra_info(name) for name in ('peername', 'sockname'))
        self.port: int = peer[1]
        recorder = TRACE.get()
        self._trace = (
            None if recorder is None else WireTrace(recorder, own[:2], peer[:2], time.time_ns())
        )
        self.dialect: Dialect = LITTLE_ENDIAN
        self._reader = reader
        self._writer = writer
        self._framer = Framer()
        self._news = asyncio.Event()
        self._task = asyncio.create_task(self._read())
        self._ticks = asyncio.create_task(self._watch_lateness())

    async def wait_for_traffic(
        self, enough: Callable[[ReceivedTraffic], object], seconds: float
    ) -> bool:
        """Wait up to `seconds` until `enough` is true of the traffic. Returns whether it is."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                while not enough(self.heard) and not self._task.done():
                    self._news.clear()
                    await self._news.wait()
        return bool(enough(self.heard))

    async def ended_within(self, seconds: float) -> bool:
        """Wait up to `seconds`, and return whether the connection has ended."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(asyncio.shield(self._task), seconds)
        return self._task.done()

    async def next_packet(self, timeout: float, *, replies: bool = False) -> Packet | None:
        """Return the next packet received, or the next reply, or None after the timeout."""
        start = len(self.heard.packets)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                while True:
                    for _, packet in self.heard.packets[start:]:
                        if not replies or packet.comm_type is CommType.SERVICE_REPLY:
                            return packet
                    start = len(self.heard.packets)
                    if self._task.done():
                        return None
                    self._news.clear()
                    await self._news.wait()
        return None

    async def ask(self, message: Message, timeout: float) -> Packet | None:
        """Send a request and return the next reply, or None if none arrives in time."""
        if self._task.done():
            return None
        self.post(message)
        return await self.next_packet(timeout, replies=True)

    def post(self, message: Message) -> None:
        """Send a request without waiting for its reply."""
        self._send(encode(request(message), self.dialect))

    async def close(self) -> None:
        """Close the connection."""
        for task in (self._task, self._ticks):
            task.cancel()
        await asyncio.gather(self._task, self._ticks, return_exceptions=True)
        if self._trace is not None:
            self._trace.finish(time.time_ns(), from_client=not self.heard.ended)
        self._writer.close()
        with contextlib.suppress(OSError, TimeoutError):
            await asyncio.wait_for(self._writer.wait_closed(), 1.0)

    async def say(self, data: bytes) -> None:
        """Send bytes that are not a message."""
        self._send(data)
        await self._writer.drain()

    def _send(self, data: bytes) -> None:
        if self._trace is not None:
            self._trace.data(time.time_ns(), data, from_client=True)
        self._writer.write(data)

    async def _watch_lateness(self) -> None:
        clock = asyncio.get_running_loop().time
        while True:
            due = clock() + TICK_S
            await asyncio.sleep(TICK_S)
            self.heard.lateness = max(self.heard.lateness, clock() - due)

    async def _read(self) -> None:
        received = self.heard
        try:
            while data := await self._reader.read(65536):
                now = asyncio.get_running_loop().time()
                if self._trace is not None:
                    self._trace.data(time.time_ns(), data, from_client=False)
                if not received.first_bytes:
                    received.first_bytes = data[:64]
                if not received.unreadable:
                    self._take(data, now)
                self._news.set()
            received.ended = 'closed by the controller'
        except OSError as error:
            received.ended = f'broken off: {reason(error)}'
            received.vanished = error.errno in (errno.ETIMEDOUT, errno.EHOSTUNREACH)
        finally:
            self._news.set()

    def _take(self, data: bytes, now: float) -> None:
        received = self.heard
        self._framer.receive_data(data)
        try:
            while (frame := self._framer.next_frame()) is not None:
                received.frames += 1
                self._take_frame(frame, now)
        except FrameError as error:
            received.unreadable = str(error)

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
    """Connect to a port until the block ends. Raises NoConnectionError if that fails."""
    began = asyncio.get_running_loop().time()
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            reader, writer = await asyncio.open_connection(host, port)
    except TimeoutError as error:
        text = f'no answer within {CONNECT_TIMEOUT_S:g} s'
        raise NoConnectionError(text, Refusal.DROPPED) from error
    except (OSError, OverflowError, ValueError) as error:
        raise NoConnectionError(reason(error), _refusal(error)) from error
    for option, (level, value) in PROBES.items():
        writer.get_extra_info('socket').setsockopt(level, option, value)
    made = Conversation(reader, writer, asyncio.get_running_loop().time() - began)
    try:
        yield made
    finally:
        await made.close()


def _refusal(error: Exception) -> Refusal:
    if isinstance(error, socket.gaierror | UnicodeError):
        return Refusal.UNKNOWN_NAME
    number = error.errno if isinstance(error, OSError) else None
    if number in (errno.ECONNREFUSED, errno.ECONNRESET):
        return Refusal.REFUSED
    return Refusal.DROPPED if number == errno.ETIMEDOUT else Refusal.UNREACHABLE
