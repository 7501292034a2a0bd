# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Programs, and sessions of the ports without sockets: bytes in, bytes out.

Every port of the controller, those of a SPEL+ program too, is a way to open sessions;
`network/port_server.py` gives them sockets, a test calls them directly.
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
"""Takes the bytes of one message or line."""


class Session(Protocol):
    """One client of one port."""

    def receive(self, data: bytes) -> None:
        """Take bytes from the client, in any segmentation.

        Raises FrameError when the position in the stream is lost: the connection must be closed.
        """

    def closed(self) -> None:
        """The client is gone: send nothing any more. Twice is no error."""


class Client(Protocol):
    """Where a client's bytes go, how its connection ends, and whether it is of this machine."""

    @property
    def local(self) -> bool:
        """Whether the client runs on the machine that the controller runs on."""

    def send(self, data: bytes) -> None:
        """Send bytes, or drop them if the connection is closed."""

    def close(self) -> None:
        """Close once everything is sent."""

    def abort(self) -> None:
        """Close at once and drop what is not sent."""


class ClientSession(Session, Protocol):
    """A port that a SPEL+ program has opened as a client.

    `wanted`: it has not closed it; `tcp_port`: of the peer that it names.
    """

    name: str
    wanted: bool

    @property
    def tcp_port(self) -> int:
        """The TCP port of the peer."""

    def begin(self, send: Send, close: Callable[[], None]) -> None:
        """Be connected."""


class ProgramPorts(Protocol):
    """The open ports of a program, and its sessions with their clients."""

    listen: Callable[[int], None]
    """Called when the program opens a TCP port that has no name here. May raise OSError."""

    connect: Callable[[ClientSession], None] | None
    """Called with a port that the program opens as a client."""

    def rejection(self, port: str) -> str | None:
        """Return why a client of a port cannot be served now, or None."""

    def session(self, port: str, send: Send, close: Callable[[], None]) -> Session:
        """Serve a client that is not rejected, until `close` ends its connection."""


Answer = Callable[[str | SpelError], None]
"""Takes what a command has printed, '' for nothing, or the error that ended it."""


class Program(Protocol):
    """Has the points of one client executed, one after the other, and answers them."""

    @property
    def ready(self) -> bool:
        """Whether it takes points as far as it is up to the program itself."""

    @property
    def runs(self) -> bool:
        """Whether its tasks keep the controller from being Ready: those that are not SPEL+ do not.

        Tasks in the background do not count.
        """

    def receive(self, frame: Frame) -> None:
        """Obey, queue or refuse one frame."""

    def step(self, dt: float) -> None:
        """Let `dt` ≥ 0 s pass for the executor, which the program feeds.

        Where a point is done within `dt`, the program answers it and gives the next one, which has
        the rest of the time: from point to point without a pause, however long the steps are.
        """

    def abort(self) -> None:
        """Brake, and answer all points that are not answered yet with FAILURE."""

    def restart(self) -> None:
        """Abort, and forget the trajectory."""

    def detach(self) -> None:
        """Forget the client, which is gone, but not its acknowledged points."""

    def pause(self) -> None:
        """Give the arm no more points and answer none, until `resume`. Twice is no error.

        What is wrong is refused all the same, and a STOP obeyed. The arm itself is held by who
        pauses.
        """

    def resume(self) -> None:
        """Go on after `pause`."""

    def boot(self) -> None:
        """Begin anew, as the controller was switched off and on again."""

    def tasks(self) -> Iterable[TaskRow] | None:
        """Return its tasks as people see them, or None if they are those of condition/tasks.py."""


class Window(Program, Protocol):
    """A SPEL+ program, which executes one command at a time, too."""

    @property
    def executes(self) -> bool:
        """Whether a command is under way."""

    def execute(self, text: str, answer: Answer) -> None:
        """Begin a command, and call `answer` when it is over, perhaps at once.

        Raises ProgramError for what cannot be executed, RuntimeError if there is one under way.
        """

    def abort_command(self, why: str) -> None:
        """Brake, and end the command that is under way, if there is one."""


VERSION = (0, 2, 0)
"""Of the controller's program, in GET_VERSION replies: major, minor, patch."""

WITHOUT_WATCHDOG = (0, 1, 0)
"""Of one that lets a motion client hang."""

Answers = Mapping[int, Callable[[], Message]]
"""What a port answers to requests besides PING, or instead of VERSION: message type to body."""

UNANSWERED = (CommType.TOPIC, CommType.SERVICE_REPLY)
"""Kinds of messages that want no answer."""

_log = logging.getLogger(__name__)


def failure(msg_type: int) -> Packet:
    """Return the FAILURE reply that is only a header."""
    return reply(Opaque(msg_type), ReplyCode.FAILURE)


def answer(packet: Packet, own: Answers) -> Packet | None:
    """Return the reply to a request, or None for topics and replies, which want none."""
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
    """Return the reply to a frame that may break the header's or the body's rules.

    None for topics and replies: two peers that answer those would do so for ever.
    """
    try:
        return answer(decode(frame), own)
    except (HeaderError, BodyError) as error:
        _log.warning('refused: %s', error)
        wanted = frame.msg_type > 0 and frame.comm_type not in UNANSWERED
        return failure(frame.msg_type) if wanted else None
