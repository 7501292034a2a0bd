# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A connection to a port that records each message with its time, and can send requests."""

import asyncio
import contextlib
import errno
import os
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from enum import Enum
from functools import partial

from epson_driver.link import Link, LinkState, WireEvent
from epson_driver.simple_message import CommType, Message, Packet
from epson_driver.trace.pcap import Conversation as WireTrace
from epson_driver.trace.pcap import PcapWriter
from epson_driver.trace.trace import NANOSECONDS

MAX_KEPT = 100_000
"""Maximum number of stored packets: the packets of eight minutes at 200 Hz."""

TRACE: ContextVar[PcapWriter | None] = ContextVar('trace', default=None)

TICK_S = 0.02
"""Period at which the lateness of this process's timers is measured, s."""

REOPENED_S = 2.0
"""Time within which a server opens its port again after a client has disconnected, s."""

RETRY_S = 0.1
FIRST_BYTES_S = 0.5
"""Time within which a state port sends its first message or closes a second connection, s."""

LOST = (os.strerror(errno.ETIMEDOUT), os.strerror(errno.EHOSTUNREACH))
"""Error texts of a connection that ends because the other machine no longer answers TCP."""


MakeLink = Callable[..., Link]

SIMPLE_MESSAGE: MakeLink = partial(Link, 'doctor', quiet=True)


class Refusal(Enum):
    """Kinds of failed connections. Each value contains a short name, a clause, and the remedy."""

    UNKNOWN_NAME = (
        'unknown name',
        'no machine with this name',
        "check the spelling and the name server, or give the controller's IP address",
    )
    REFUSED = (
        'nothing listens',
        'the machine replies, but nothing listens at this port',
        'start the program on the controller, check state_port',
    )
    DROPPED = (
        'no reply',
        'no reply from this address',
        'check the address, the network mask, the cable, and that the controller is on; a '
        'firewall may drop the packets',
    )
    UNREACHABLE = (
        'no route',
        'no route to this address',
        "check the address, the cable, and this machine's network settings",
    )


class NoConnectionError(ConnectionError):
    def __init__(self, text: str, refusal: Refusal) -> None:
        super().__init__(text)
        self.refusal = refusal


@dataclass
class ReceivedTraffic:
    """The data received over one connection. Times are s on the monotonic clock."""

    handshake: float = 0.0  # duration of TCP's handshake, s
    packets: list[tuple[float, Packet]] = field(default_factory=list)
    unreadable: str = ''  # error text for the first bytes that were no message
    ended: str = ''  # reason for the end of the connection
    first_bytes: bytes = b''
    lateness: float = 0.0  # maximum delay of a timer in this process, s: uncertainty of times

    @property
    def vanished(self) -> bool:
        """Whether the connection was lost because the other machine stopped answering TCP."""
        return self.ended.endswith(LOST)


class Conversation:
    """One connection to a port of the controller, made with the driver's link class."""

    def __init__(self, host: str, port: int, make: MakeLink) -> None:
        self.traffic = ReceivedTraffic()
        self.port = port
        self.link = make(host, port, on_packet=self._take, on_state=self._change)
        self.link.trace = self._record
        self._news = asyncio.Event()
        self._reply: asyncio.Future[Packet] | None = None
        self._trace: WireTrace | None = None
        self._began = asyncio.get_running_loop().time()
        self._established = False
        self._tasks = [asyncio.create_task(part) for part in (self._run(), self._ticks())]

    async def connected(self) -> None:
        await self._wait(lambda: self.link.connected or self.traffic.ended)
        if not self._established:
            raise NoConnectionError(self.traffic.ended, refusal_of(self.link.failure))

    async def wait_for_traffic(
        self, enough: Callable[[ReceivedTraffic], object], seconds: float
    ) -> bool:
        """Wait until `enough(traffic)` is true, for at most `seconds`.

        Return whether it is true.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._wait(lambda: enough(self.traffic) or self.traffic.ended)
        return bool(enough(self.traffic))

    async def ended_within(self, seconds: float) -> bool:
        return await self.wait_for_traffic(lambda traffic: traffic.ended, seconds)

    async def another_packet(self, timeout: float) -> bool:
        count = len(self.traffic.packets)
        return await self.wait_for_traffic(lambda traffic: len(traffic.packets) > count, timeout)

    async def ask(self, message: Message, timeout: float) -> Packet | None:
        self._reply = reply = asyncio.get_running_loop().create_future()
        self.post(message)
        await self.wait_for_traffic(lambda traffic: reply.done(), timeout)
        self._reply = None
        return reply.result() if reply.done() else None

    def post(self, message: Message) -> None:
        with contextlib.suppress(ConnectionError):  # `heard` has the reason
            self.link.post(message, lambda packet, _: self._take(packet))

    def restart(self) -> None:
        """Clear the recorded traffic, and record new traffic in the current trace."""
        self._finish()
        self.traffic.packets.clear()
        if self.link.addresses is not None:
            self._record(WireEvent.OPENED, b'')

    async def close(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._finish()

    async def _run(self) -> None:
        link = asyncio.create_task(self.link.run())
        try:
            await self._wait(lambda: self.traffic.ended)
        finally:
            link.cancel()
            await asyncio.gather(link, return_exceptions=True)

    async def _ticks(self) -> None:
        clock = asyncio.get_running_loop().time
        while True:
            due = clock() + TICK_S
            await asyncio.sleep(TICK_S)
            self.traffic.lateness = max(self.traffic.lateness, clock() - due)

    async def _wait(self, condition: Callable[[], object]) -> None:
        while not condition():
            news = self._news
            await news.wait()

    def _change(self, state: LinkState, why: str) -> None:
        self._established |= state is LinkState.CONNECTED
        if state is LinkState.BACKING_OFF and not self.traffic.ended:
            self.traffic.ended = why.removeprefix(f'{self.link.host}:{self.port}: ')
        self._notify()

    def _notify(self) -> None:
        self._news.set()
        self._news = asyncio.Event()

    def _take(self, packet: Packet) -> None:
        if len(self.traffic.packets) < MAX_KEPT:
            self.traffic.packets.append((self.link.last_received, packet))
        reply = self._reply
        if reply is not None and packet.comm_type is CommType.SERVICE_REPLY and not reply.done():
            reply.set_result(packet)
        self._notify()

    def _record(self, event: WireEvent, data: bytes, age: float = 0.0) -> None:
        now, traffic = time.time_ns() - round(age * NANOSECONDS), self.traffic
        if event is WireEvent.OPENED:
            traffic.handshake = traffic.handshake or self.link.last_received - self._began
            recorder, ends = TRACE.get(), self.link.addresses
            self._trace = WireTrace(recorder, *ends, now) if recorder and ends else None
        elif event is WireEvent.RECEIVED:
            traffic.first_bytes = traffic.first_bytes or data[:64]
        traffic.unreadable = traffic.unreadable or self.link.statistics.last_bad_frame
        if self._trace is not None and data:
            self._trace.data(now, data, from_client=event is WireEvent.SENT)

    def _finish(self) -> None:
        if self._trace is not None:
            self._trace.finish(time.time_ns(), from_client=not self.traffic.ended)
            self._trace = None


async def opened(
    host: str,
    port: int,
    *,
    sends: bool = False,
    make: MakeLink = SIMPLE_MESSAGE,
    pause: float = RETRY_S,
) -> Conversation:
    """Connect to a port. Raises NoConnectionError if that fails.

    A server may need REOPENED_S to open its port again after another client has left, so a refused
    connection is retried every `pause` s. `sends`: whether the server sends messages without a
    request. A connection to such a server is also retried if the server closes it before the first
    message. `make` creates the link.
    """
    clock = asyncio.get_running_loop().time
    deadline = clock() + REOPENED_S
    while True:
        made = Conversation(host, port, make)
        try:
            await made.connected()
            if sends:
                await made.wait_for_traffic(lambda traffic: traffic.packets, FIRST_BYTES_S)
            if (
                not (sends and made.traffic.ended and not made.traffic.first_bytes)
                or clock() >= deadline
            ):
                return made
        except BaseException as error:
            await made.close()
            refused = isinstance(error, NoConnectionError) and error.refusal is Refusal.REFUSED
            if not refused or clock() >= deadline:
                raise
        await made.close()
        await asyncio.sleep(pause)


@asynccontextmanager
async def conversation(
    host: str, port: int, *, sends: bool = False, pause: float = RETRY_S
) -> AsyncIterator[Conversation]:
    made = await opened(host, port, sends=sends, pause=pause)
    try:
        yield made
    finally:
        await made.close()


def refusal_of(error: BaseException | None) -> Refusal:
    if isinstance(error, socket.gaierror | UnicodeError):
        return Refusal.UNKNOWN_NAME
    number = error.errno if isinstance(error, OSError) else None
    if number in (errno.ECONNREFUSED, errno.ECONNRESET) or error is None:
        return Refusal.REFUSED
    dropped = number == errno.ETIMEDOUT or isinstance(error, TimeoutError)
    return Refusal.DROPPED if dropped else Refusal.UNREACHABLE
