# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver's side of one port of a controller: a TCP connection that reconnects."""

import asyncio
import contextlib
import logging
import socket
from collections import Counter, deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

from epson_driver.inputs import HOST
from epson_driver.link.connection import (
    CLOSED,
    Address,
    AnyFramer,
    Connection,
    Receivers,
    Tap,
    WireEvent,
)
from epson_driver.link.replies import PendingReplies, PendingRequest
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

MAX_LATENCIES = 512


@dataclass
class LinkStatistics:
    connections: int = 0
    connected_since: float | None = None  # loop time, s
    frames_received: int = 0
    frames_sent: int = 0
    bytes_received: int = 0
    bytes_sent: int = 0
    unsolicited_replies: int = 0
    bad_frames: Counter[str] = field(default_factory=Counter)
    """Number of invalid frames by their invalid field (`length`, `comm_type`, `body`, …)."""
    last_bad_frame: str = ''  # error text of the last invalid frame, or ''
    reply_latencies: deque[float] = field(default_factory=lambda: deque(maxlen=MAX_LATENCIES))
    """Latest times from a request to its reply, s, in order of arrival."""


CONNECT_TIMEOUT_S = 1.0
MIN_PROVEN_UPTIME_S = 1.0
"""Duration of a connection after which the back-off is reset, so that the first reconnection is
immediate, s. A controller that already serves another client closes the connection sooner, so the
back-off grows."""

MAX_UNSENT_BYTES = 65536
"""Maximum number of unsent bytes. If a controller reads too slowly, the driver disconnects before
it sends another message (docs/invariants.md, 7)."""

DIALECT_MESSAGES = (JointPosition, JointFeedback)
"""Messages that determine the dialect. Every state server sends one of these two types, and the
length of the message shows the width of its reals."""

_TOPIC, _REPLY = CommType.TOPIC, CommType.SERVICE_REPLY  # faster than the enum's members

_log = logging.getLogger(__name__)


class Link:
    """A connection to one port, which converts bytes to packets and reconnects automatically.

    `run` connects, receives, and reconnects until it is cancelled. Callbacks run in the event
    loop. `on_packet` receives every topic and every unexpected reply. `on_state` receives each new
    state and the reason for it.

    * `byte_order`: byte order of the controller. None: it is detected from the first bytes of each
      connection.
    * `receive_timeout`: the connection is closed if no complete message arrives for this time, s.
      With None, only TCP keepalive detects a vanished peer.
    * `trace`: called with each step of a connection. The attribute may be set at any time.
    * `quiet`: whether bad frames are logged only at debug level, because another service may
      listen on the port.
    * `before_connecting`: awaited before each connection attempt.
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
        """Dialect of sent messages. Received joint positions and `follow` change it."""
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
        self._now: Callable[[], float]
        """The event loop's clock, s. `run` stores it here, because looking up the loop is slow."""
        self._written: Dialect | None = None  # last dialect sent on this connection
        self.attempt = 0  # since a connection longer than MIN_PROVEN_UPTIME_S
        self.failure: Exception | None = None  # of the last attempt, if it failed
        self.turned_away = 0  # successive connections that the controller closed immediately
        self.joints_withheld = False  # no joint positions are normal now
        self.flags: tuple[str, ...] = ()  # EPSON's status flags that are set, if known
        self.last_received = 0.0  # loop time of the last read, s

    @property
    def connected(self) -> bool:
        return self.state is LinkState.CONNECTED

    @property
    def addresses(self) -> tuple[Address, Address] | None:
        if self._connection is None:
            return None
        transport = self._connection.transport
        addresses = [transport.get_extra_info(name) for name in ('sockname', 'peername')]
        if None in addresses:  # the connection has ended
            return None
        own, other = addresses
        return (own[0], own[1]), (other[0], other[1])

    @property
    def transport(self) -> asyncio.Transport | None:
        return None if self._connection is None else self._connection.transport

    @property
    def unread(self) -> bytes:
        return b'' if self._connection is None else self._connection.framer.unread

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        self._now = loop.time
        self._step(LinkEvent.OPEN, f'connecting to {self.host}:{self.port}')
        try:
            while True:
                if self._before_connecting is not None:
                    await self._before_connecting()
                start = loop.time()
                established = await self._connect_and_receive()
                if established and loop.time() - established > MIN_PROVEN_UPTIME_S:
                    self.attempt = 0
                pause = back_off(self.attempt) - (loop.time() - start)
                self.attempt += 1
                await asyncio.sleep(max(pause, 0.0))
                self._step(LinkEvent.RETRY, f'attempt {self.attempt}')
        finally:
            self._step(LinkEvent.CLOSE, 'closed')

    def post(self, message: Message, on_reply: Callable[[Packet, float], None]) -> PendingRequest:
        """Send a request. `on_reply` gets the reply and its time, s.

        Raises ConnectionError if the link is down or the controller reads too slowly.
        """
        if self._connection is None:
            raise ConnectionError(f'{self.name} link is {self.state.value}')
        data = encode(request(message), self.dialect)
        now = self._now()
        self._written = self.dialect
        self._write(self._connection, data)
        waiting = PendingRequest(message, now, on_reply)
        self._pending.add(waiting)
        return waiting

    def give_up(self, waiting: PendingRequest) -> None:
        """Stop waiting for a reply. If the request is numbered, its late reply is ignored."""
        self._pending.give_up(waiting)

    def send_topic(self, message: Message) -> None:
        """Send a topic, which has no reply. Raises the exceptions of `post`."""
        if self._connection is None:
            raise ConnectionError(f'{self.name} link is {self.state.value}')
        data = encode(topic(message), self.dialect)
        self._written = self.dialect
        self._write(self._connection, data)

    def follow(self, dialect: Dialect) -> None:
        """Use the dialect of the state port. Reconnect if data was sent or received in another."""
        self.dialect = dialect
        if self._connection is None:
            return
        received_order = self._connection.framer.byte_order
        if self._written not in (None, dialect):
            self.reconnect(f'sent {self._written}, but the state port uses {dialect}')
        elif received_order not in (None, dialect.byte_order):
            self.reconnect(
                f'received {received_order.name.lower()} endian, but the state port uses {dialect}'
            )

    def reconnect(self, why: str) -> None:
        """Close the connection once all data is sent, and reconnect. Pending replies are lost."""
        if self._connection is not None:
            self._connection.close(why)
            self._connection = None

    @property
    def unsent(self) -> int:
        """Number of bytes that are waiting because the controller has not read earlier bytes."""
        transport = self.transport
        return 0 if transport is None else transport.get_write_buffer_size()

    async def _connect_and_receive(self) -> float | None:
        """Connect, and receive until the connection ends.

        Returns the loop time at which the connection was established, or None if it was not.
        """
        loop = asyncio.get_running_loop()
        connection = Connection(self._receivers, self._new_framer(), self._receive_timeout)
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                await loop.create_connection(lambda: connection, self.host, self.port)
        except (OSError, TimeoutError, ValueError) as error:  # ValueError: invalid host name
            self.failure, self.turned_away = error, 0
            why = reason(error) or f'no answer within {CONNECT_TIMEOUT_S:g} s'
            self._step(LinkEvent.FAILED, f'{self.host}:{self.port}: {why}')
            return None
        established = loop.time()
        self.failure = None
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
        short = loop.time() - established < MIN_PROVEN_UPTIME_S
        turned_away = short and why.startswith(CLOSED)
        self.turned_away = self.turned_away + 1 if turned_away else 0
        event = LinkEvent.LOST if self.connected else LinkEvent.FAILED
        self._step(event, f'{self.host}:{self.port}: {why}')
        return established

    def _new_framer(self) -> AnyFramer:
        return PacketFramer(self._byte_order)

    async def _serve(self, connection: Connection) -> str:
        self._establish()
        connection.start()
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
            self._handle_reply(packet)
        else:
            self._answer(packet)

    def _handle_reply(self, packet: Packet) -> None:
        waiting = self._pending.take(packet)
        if waiting is None:
            self.statistics.unsolicited_replies += 1
            self._on_packet(packet)
            return
        self.statistics.reply_latencies.append(self.last_received - waiting.sent)
        waiting.on_reply(packet, self.last_received)

    def _answer(self, packet: Packet) -> None:
        """Reply to a request (REP-I0006): echo a PING, and reply FAILURE to any other request."""
        if isinstance(packet.message, Ping):
            answer = reply(Ping(packet.message.padding), ReplyCode.SUCCESS)
        else:
            answer = reply(Opaque(packet.msg_type), ReplyCode.FAILURE)
        if self._connection is not None:
            with contextlib.suppress(ConnectionError):  # the connection has already ended
                self._write(self._connection, encode(answer, packet.dialect))

    def _write(self, connection: Connection, data: bytes) -> None:
        """Send data. If the controller does not read, disconnect and raise ConnectionError."""
        if connection.transport.get_write_buffer_size() > MAX_UNSENT_BYTES:
            why = 'the controller does not read the sent data'
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
        self.statistics.last_bad_frame = str(error)
        level = logging.DEBUG if self._quiet else logging.WARNING
        line = self._log_throttle.line(str(error), self._now())
        if line is not None:
            _log.log(level, '%s link: bad frame: %s', self.name, line)

    def _step(self, event: LinkEvent, why: str) -> None:
        self.state = TRANSITIONS[self.state, event]
        self._on_state(self.state, why)


def _configure(connection: socket.socket) -> None:
    """Disable send delays, and set keepalive to detect a vanished peer within about 3 s."""
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
