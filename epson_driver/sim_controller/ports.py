# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Programs, and sessions of the ports without sockets: bytes in, bytes out.

Every port of the controller, including a SPEL+ program's ports, opens sessions.
`network/port_server.py` connects them to sockets, and tests call them directly.
"""

import logging
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from epson_driver.sim_controller.condition.tasks import TaskRow
from epson_driver.simple_message import (
    BodyError,
    CommType,
    Frame,
    GetVersion,
    HeaderError,
    Message,
    MessageType,
    Opaque,
    Packet,
    Ping,
    ReplyCode,
    decode,
    reply,
)
from epson_driver.spel import SpelError

Send = Callable[[bytes], None]
"""Sends the bytes of one message or line."""


class Session(Protocol):
    """One client of one port."""

    def receive(self, data: bytes) -> None:
        """Process bytes from the client, in any segmentation.

        Raises FrameError when frame synchronization is lost, after which the connection must be
        closed.
        """

    def closed(self) -> None:
        """Stop sending after the client has disconnected. Calling it twice is allowed."""


class Client(Protocol):
    """Destination of a client's bytes, with its connection and whether it is local."""

    @property
    def local(self) -> bool:
        """Whether the client runs on the controller's machine."""

    def send(self, data: bytes) -> None:
        """Send bytes, or drop them if the connection is closed."""

    def close(self) -> None:
        """Close once all bytes are sent."""

    def abort(self) -> None:
        """Close immediately and drop unsent bytes."""


class ClientSession(Session, Protocol):
    """A port that a SPEL+ program has opened as a client.

    `wanted`: the program has not closed it. `tcp_port`: port of its peer.
    """

    name: str
    wanted: bool

    @property
    def tcp_port(self) -> int:
        """The TCP port of the peer."""

    def begin(self, send: Send, close: Callable[[], None]) -> None:
        """Start the session with a connected peer."""


class ProgramPorts(Protocol):
    """The open ports of a program, and its sessions with their clients."""

    listen: Callable[[int], None]
    """Called when the program opens a TCP port without a name here. May raise OSError."""

    connect: Callable[[ClientSession], None] | None
    """Called with a port that the program opens as a client."""

    def rejection(self, port: str) -> str | None:
        """Return why a client of a port cannot be served now, or None."""

    def session(self, port: str, send: Send, close: Callable[[], None]) -> Session:
        """Serve an accepted client, until `close` ends its connection."""


Answer = Callable[[str | SpelError], None]
"""Gets the output of a command ('' for none), or the error that ended it."""


class Program(Protocol):
    """Executes the points of one client, one after the other, and answers them."""

    @property
    def ready(self) -> bool:
        """Whether the program itself is ready to accept points."""

    @property
    def runs(self) -> bool:
        """Whether its tasks keep the controller from being Ready, which only SPEL+ tasks do.

        Background tasks do not count.
        """

    def receive(self, frame: Frame) -> None:
        """Execute, queue or refuse one frame."""

    def step(self, dt: float) -> None:
        """Advance the executor by `dt` ≥ 0 s and supply its points.

        If a point is done within `dt`, the program answers it and supplies the next one, which
        gets the remaining time. So the arm moves from point to point without a pause for any step
        size.
        """

    def abort(self) -> None:
        """Brake, and answer all unanswered points with FAILURE."""

    def restart(self) -> None:
        """Abort and discard the trajectory."""

    def detach(self) -> None:
        """Discard the disconnected client, but keep its acknowledged points."""

    def pause(self) -> None:
        """Give the arm no more points and answer none, until `resume`.

        Calling it twice is allowed. Invalid points are still refused, and STOP still works. The
        caller pauses the arm itself.
        """

    def resume(self) -> None:
        """Resume after `pause`."""

    def boot(self) -> None:
        """Restart after a power cycle of the controller."""

    def tasks(self) -> Iterable[TaskRow] | None:
        """Return its tasks for display, or None if condition/tasks.py lists them."""


class Window(Program, Protocol):
    """A SPEL+ program that can also execute commands, one at a time."""

    @property
    def executes(self) -> bool:
        """Whether a command is executing."""

    def execute(self, text: str, answer: Answer) -> None:
        """Start a command, and call `answer` when it is over, possibly immediately.

        Raises ProgramError if the command is invalid, RuntimeError if one is executing.
        """

    def abort_command(self, why: str) -> None:
        """Brake and end the current command, if any."""


VERSION = (0, 2, 0)
"""Version of the controller's program in GET_VERSION replies: major, minor, patch."""

WITHOUT_WATCHDOG = (0, 1, 0)
"""Version of a program without watchdog for a stalled motion client."""

Answers = Mapping[int, Callable[[], Message]]
"""Message type → reply body, for requests besides PING, or instead of VERSION."""

UNANSWERED = (CommType.TOPIC, CommType.SERVICE_REPLY)
"""Message types that are not answered."""

_log = logging.getLogger(__name__)


def failure(msg_type: int) -> Packet:
    """Return a FAILURE reply, which has only a header."""
    return reply(Opaque(msg_type), ReplyCode.FAILURE)


def answer(packet: Packet, own: Answers) -> Packet | None:
    """Return the reply to a request, or None for topics and replies, which are not answered."""
    if packet.comm_type is not CommType.SERVICE_REQUEST:
        return None
    if isinstance(packet.message, Ping):
        return reply(Ping((0,) * len(packet.message.padding)), ReplyCode.SUCCESS)
    if packet.msg_type in own:
        return reply(own[packet.msg_type](), ReplyCode.SUCCESS)
    if packet.msg_type == MessageType.GET_VERSION:
        return reply(GetVersion(VERSION), ReplyCode.SUCCESS)
    return failure(packet.msg_type)


def answer_frame(frame: Frame, own: Answers) -> Packet | None:
    """Return the reply to a frame that may have an invalid header or body.

    Return None for topics and replies. Two peers that answer them would do so forever.
    """
    try:
        return answer(decode(frame), own)
    except (HeaderError, BodyError) as error:
        _log.warning('refused: %s', error)
        wanted = frame.msg_type > 0 and frame.comm_type not in UNANSWERED
        return failure(frame.msg_type) if wanted else None
