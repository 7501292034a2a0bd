# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A TCP connection to one port of a controller that comes back by itself."""

import asyncio
import contextlib
import logging
import socket
from collections import Counter, deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

from epson_driver.inputs import HOST
from epson_driver.link.connection import Address, AnyFramer, Connection, Receivers, Tap, WireEvent
from epson_driver.link.replies import PendingReplies, PendingRequest, command_of, sequence_of
from epson_driver.link.states import TRANSITIONS, LinkEvent, LinkState, back_off
from epson_driver.log_lines import LogThrottle
from epson_driver.simple_message import (
    ByteOrder,
    CommType,
    Dialect,
    FrameError,
    JointFeedback,
    JointPosition,
    Message,
    Opaque,
    Packet,
    PacketFramer,
    Ping,
    ReplyCode,
    SimpleMessageError,
    encode,
    reply,
    request,
    topic,
)
from epson_driver.socket_errors import reason

KEPT_LATENCIES = 512


@dataclass
class LinkStatistics:
    """Counters since the link object was made, bounded in memory."""

    connections: int = 0
    connected_since: float | None = None
    """Loop time at which the present connection was established, s; None without one."""
    frames_received: int = 0
    frames_sent: int = 0
    bytes_received: int = 0
    bytes_sent: int = 0
    unsolicited_replies: int = 0
    bad_frames: Counter[str] = field(default_factory=Counter)
    """By the field that was wrong (`length`, `comm_type`, `body`, …)."""
    reply_latencies: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT_LATENCIES))
    """Seconds from a request to its reply, the newest last."""


CONNECT_TIMEOUT_S = 1.0
MIN_PROVEN_UPTIME_S = 1.0
"""A connection that lasted this long, s, makes the next retry immediate. One that was closed
sooner (a controller that has its one client already) leaves the back-off where it was."""

MAX_UNSENT_BYTES = 65536
"""A controller that leaves more bytes than this unread is disconnected (docs/invariants.md, 7)."""

DIALECT_MESSAGES = (JointPosition, JointFeedback)
"""Messages of every state server that carry reals, so that their length shows the width."""

_TOPIC, _REPLY = CommType.TOPIC, CommType.SERVICE_REPLY
"""For each packet; to get a member from its enum costs several times as much."""

_log = logging.getLogger(__name__)


class Link:
    """Keeps one connection alive and turns its bytes into packets.

    `run` connects, receives, and connects again until it is cancelled. The callbacks are called
    in the event loop: `on_packet` with every topic and every reply that nobody waits for,
    `on_state` after each change with the new state and a sentence that says why.

    `receive_timeout` in s closes a connection on which no complete message came for longer, None
    waits for ever (then only the keepalive notices a peer that vanished). `byte_order` None
    detects the peer's from its first bytes, anew for each connection. The attribute `dialect` is
    how requests are written; it follows what is received, and may be set. `trace` is called with
    each step of a connection; it may be set or taken away at any time. `quiet` logs bad frames
    for debugging only: for a port where something else may listen. `before_connecting` is awaited
    before each attempt.
    """

    def __init__(
        self,
        name: str,
        host: str,
        port: int,
        *,
        on_packet: Callable[[Packet], None],
        on_state: Callable[[LinkState, str], None],
        byte_order: ByteOrder | None = None,
        receive_timeout: float | None = None,
        trace: Tap | None = None,
        quiet: bool = False,
        before_connecting: Callable[[], Awaitable[object]] | None = None,
    ) -> None:
        self.name = name
        self.host: str = HOST.checked(host, f'{name} link: host')
        self.port = port
        self.state = LinkState.DISCONNECTED
        self.dialect = Dialect(byte_order or ByteOrder.LITTLE)
        self.statistics = LinkStatistics()
        self._byte_order = byte_order
        self._on_packet = on_packet
        self._on_state = on_state
        self._receive_timeout = receive_timeout
        self.trace = trace
        self._quiet = quiet
        self._before_connecting = before_connecting
        self._log_throttle = LogThrottle()
        self._pending = PendingReplies()
        self._receivers = Receivers(
            self._received, self._dispatch, self._bad_frame, self._on_event
        )
        self._connection: Connection | None = None
        """The one that messages can be sent on; None while there is none."""
        self._now: Callable[[], float]
        """The loop's time, s, from `run` on; to ask for the running loop costs a system call."""
        self._written: Dialect | None = None
        """What was sent last on this connection was written in it; None before that."""
        self.attempt = 0
        """Attempts to connect since a connection has lasted."""
        self.joints_withheld = False
        """The controller tells no joints in its present condition, and that is as it should be."""
        self.last_received = 0.0
        """When the newest bytes were read, loop time, s: what was read at once came no later."""

    @property
    def connected(self) -> bool:
        """True while requests can be sent."""
        return self.state is LinkState.CONNECTED

    @property
    def addresses(self) -> tuple[Address, Address] | None:
        """Our own and the controller's end of the connection, or None while there is none."""
        if self._connection is None:
            return None
        transport = self._connection.transport
        ends = [transport.get_extra_info(name) for name in ('sockname', 'peername')]
        if None in ends:  # it died before it could be asked
            return None
        own, other = ends
        return (own[0], own[1]), (other[0], other[1])

    @property
    def transport(self) -> asyncio.Transport | None:
        """The connection's transport, or None while there is none."""
        return None if self._connection is None else self._connection.transport

    @property
    def unread(self) -> bytes:
        """The received bytes of a frame that is not complete yet."""
        return b'' if self._connection is None else self._connection.framer.unread

    async def run(self) -> None:
        """Keep the link alive until this is cancelled."""
        loop = asyncio.get_running_loop()
        self._now = loop.time
        self._step(LinkEvent.OPEN, f'connecting to {self.host}:{self.port}')
        try:
            while True:
                if self._before_connecting is not None:
                    await self._before_connecting()
                began = loop.time()
                established = await self._connect_and_receive()
                if established and loop.time() - established > MIN_PROVEN_UPTIME_S:
                    self.attempt = 0
                pause = back_off(self.attempt) - (loop.time() - began)
                self.attempt += 1
                await asyncio.sleep(max(pause, 0.0))
                self._step(LinkEvent.RETRY, f'attempt {self.attempt}')
        finally:
            self._step(LinkEvent.CLOSE, 'closed')

    def post(self, message: Message, on_reply: Callable[[Packet, float], None]) -> PendingRequest:
        """Send a request, whose reply goes to `on_reply` with the loop's time, s.

        Returns what `give_up` takes. Raises ConnectionError if the link is not connected or the
        controller does not read, FieldError if a value does not fit.
        """
        if self._connection is None:
            raise ConnectionError(f'{self.name} link is {self.state.value}')
        packet = request(message)
        data = encode(packet, self.dialect)
        now = self._now()
        self._written = self.dialect
        self._write(self._connection, data)
        waiting = PendingRequest(
            packet.msg_type, sequence_of(message), now, on_reply, command_of(message)
        )
        self._pending.add(waiting)
        return waiting

    def give_up(self, waiting: PendingRequest) -> None:
        """Wait no longer for a reply, and let a late one answer nothing else."""
        self._pending.give_up(waiting)

    def tell(self, message: Message) -> None:
        """Send a topic, which is not answered. Raises as `post` does."""
        if self._connection is None:
            raise ConnectionError(f'{self.name} link is {self.state.value}')
        data = encode(topic(message), self.dialect)
        self._written = self.dialect
        self._write(self._connection, data)

    def follow(self, dialect: Dialect) -> None:
        """Write as another port of the controller does.

        A connection on which something went in another way connects again: what was sent cannot
        have been understood, and what is received on it later could not be.
        """
        self.dialect = dialect
        if self._connection is None:
            return
        came = self._connection.framer.byte_order
        if self._written not in (None, dialect):
            self.reconnect(f'what was sent was {self._written}, the state is {dialect}')
        elif came not in (None, dialect.byte_order):
            self.reconnect(f'what came was {came.name.lower()} endian, the state is {dialect}')

    def reconnect(self, why: str) -> None:
        """Close the connection, if there is one, once everything is sent, and connect again.

        Replies that were on their way are not received any more.
        """
        if self._connection is not None:
            self._connection.close(why)
            self._connection = None

    @property
    def unsent(self) -> int:
        """Bytes not sent yet, as the controller has not read earlier ones."""
        transport = self.transport
        return 0 if transport is None else transport.get_write_buffer_size()

    async def _connect_and_receive(self) -> float | None:
        """Return when the connection was established (loop time, s), or None if it was not."""
        loop = asyncio.get_running_loop()
        connection = Connection(self._receivers, self._new_framer(), self._receive_timeout)
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                await loop.create_connection(lambda: connection, self.host, self.port)
        except (OSError, TimeoutError, ValueError) as error:  # ValueError: no name of a host
            why = reason(error) or f'no answer within {CONNECT_TIMEOUT_S:g} s'
            self._step(LinkEvent.FAILED, f'{self.host}:{self.port}: {why}')
            return None
        established = loop.time()
        _configure(connection.transport.get_extra_info('socket'))
        self._connection = connection
        self.last_received = established
        self._written = None
        try:
            self._on_event(WireEvent.OPENED)
            why = await self._serve(connection)
        finally:
            self._on_event(WireEvent.CLOSED)
            self._connection = None
            self.statistics.connected_since = None
            self._pending.clear()
            connection.end('closed')
        event = LinkEvent.LOST if self.connected else LinkEvent.FAILED
        self._step(event, f'{self.host}:{self.port}: {why}')
        return established

    def _new_framer(self) -> AnyFramer:
        return PacketFramer(self._byte_order)

    async def _serve(self, connection: Connection) -> str:
        """Receive on a connection until it ends, and return why it did."""
        self._establish()
        connection.begin()
        return await connection.ended

    def _establish(self) -> None:
        self.statistics.connections += 1
        self.statistics.connected_since = self._now()
        self._step(LinkEvent.ESTABLISHED, f'{self.host}:{self.port}')

    def _received(self, data: bytes) -> None:
        self.last_received = self._now()
        self.statistics.bytes_received += len(data)
        if self.trace is not None:
            self.trace(WireEvent.RECEIVED, data)

    def _dispatch(self, packet: Packet) -> None:
        self.statistics.frames_received += 1
        if isinstance(packet.message, DIALECT_MESSAGES):
            self.dialect = packet.dialect
        if packet.comm_type is _TOPIC:
            self._on_packet(packet)
        elif packet.comm_type is _REPLY:
            self._settle(packet)
        else:
            self._answer(packet)

    def _settle(self, packet: Packet) -> None:
        waiting = self._pending.take(packet)
        if waiting is None:
            self.statistics.unsolicited_replies += 1
            self._on_packet(packet)
            return
        self.statistics.reply_latencies.append(self.last_received - waiting.sent)
        waiting.on_reply(packet, self.last_received)

    def _answer(self, packet: Packet) -> None:
        """REP-I0006: a PING is echoed, any other request to a client fails."""
        if isinstance(packet.message, Ping):
            answer = reply(Ping(packet.message.padding), ReplyCode.SUCCESS)
        else:
            answer = reply(Opaque(packet.msg_type), ReplyCode.FAILURE)
        if self._connection is not None:
            with contextlib.suppress(ConnectionError):  # it has ended then
                self._write(self._connection, encode(answer, packet.dialect))

    def _write(self, connection: Connection, data: bytes) -> None:
        """Raises ConnectionError, and ends the connection, if the controller does not read."""
        if connection.transport.get_write_buffer_size() > MAX_UNSENT_BYTES:
            why = 'the controller leaves what is sent unread'
            connection.abort(why)
            raise ConnectionError(why)
        connection.transport.write(data)
        self.statistics.frames_sent += 1
        self.statistics.bytes_sent += len(data)
        if self.trace is not None:
            self.trace(WireEvent.SENT, data)

    def _on_event(self, event: WireEvent) -> None:
        if self.trace is not None:
            self.trace(event, b'')

    def _bad_frame(self, error: SimpleMessageError) -> None:
        self.statistics.frames_received += not isinstance(error, FrameError)
        self.statistics.bad_frames[error.field] += 1
        level = logging.DEBUG if self._quiet else logging.WARNING
        line = self._log_throttle.line(str(error), self._now())
        if line is not None:
            _log.log(level, '%s link: bad frame: %s', self.name, line)

    def _step(self, event: LinkEvent, why: str) -> None:
        self.state = TRANSITIONS[self.state, event]
        self._on_state(self.state, why)


def _configure(connection: socket.socket) -> None:
    """Send small frames without delay, and notice a peer that vanished in about 3 s.

    What the platform does not have is left out; a socket that died already says so when read.
    """
    for level, option, value in (
        (socket.IPPROTO_TCP, 'TCP_NODELAY', 1),
        (socket.SOL_SOCKET, 'SO_KEEPALIVE', 1),
        (socket.IPPROTO_TCP, 'TCP_KEEPIDLE', 1),
        (socket.IPPROTO_TCP, 'TCP_KEEPINTVL', 1),
        (socket.IPPROTO_TCP, 'TCP_KEEPCNT', 2),
        (socket.IPPROTO_TCP, 'TCP_USER_TIMEOUT', 3000),
    ):
        with contextlib.suppress(AttributeError, OSError):
            connection.setsockopt(level, getattr(socket, option), value)
