# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Interfaces of the controller's ports and programs, without sockets.

A session serves one client of a port: it receives bytes, and sends bytes with the client's `send`.
`network/port_server.py` connects sessions to sockets. Tests call them directly.
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
"""Function that sends the bytes of one message or line."""


class Session(Protocol):
    """The session of one client of a port."""

    def receive(self, data: bytes) -> None:
        """Process bytes from the client, in any segmentation.

        Raises FrameError if frame synchronization is lost. The connection must then be closed.
        """

    def closed(self) -> None:
        """End the session after the client has disconnected. Repeated calls are allowed."""


class Client(Protocol):
    """The connection to a client, as used by the sessions."""

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
    """The session of a port that a SPEL+ program has opened as a client.

    `is_open`: whether the program has not closed the port yet.
    """

    name: str
    is_open: bool

    @property
    def tcp_port(self) -> int:
        """The TCP port of the peer."""

    def start(self, send: Send, close: Callable[[], None]) -> None:
        """Start the session with a connected peer."""


class ProgramPorts(Protocol):
    """The ports that a SPEL+ program opens."""

    listen: Callable[[int], None]
    """Called with a TCP port that the program opens as a server. May raise OSError.

    It is not called for the controller's own ports, which are always open.
    """

    connect: Callable[[ClientSession], None] | None
    """Called with a port that the program opens as a client (None: no network)."""

    def rejection(self, port: str) -> str | None:
        """Return why a client of a port cannot be served now, or None."""

    def session(self, port: str, send: Send, close: Callable[[], None]) -> Session:
        """Return the session for an accepted client. It calls `close` to disconnect the client."""


Answer = Callable[[str | SpelError], None]
"""Function that is called with the output of a statement ('' for none), or with its error."""


class Program(Protocol):
    """A program that moves the arm and answers the messages of the motion client."""

    @property
    def ready(self) -> bool:
        """Whether the program itself is ready to accept points."""

    @property
    def runs(self) -> bool:
        """Whether a SPEL+ task other than a background task is running.

        If so, the controller is not Ready. The built-in programs do not count.
        """

    def receive(self, frame: Frame) -> None:
        """Execute, queue or refuse one frame."""

    def step(self, dt: float) -> None:
        """Advance the executor by `dt` ≥ 0 s and supply its points.

        If a point is done within `dt`, the program answers it, supplies the next one and advances
        by the remaining time. So the step size does not cause pauses between points.
        """

    def abort(self) -> None:
        """Brake, and answer all unanswered points with FAILURE."""

    def restart(self) -> None:
        """Abort, and discard the trajectory."""

    def detach(self) -> None:
        """Discard the unacknowledged points of a client that has disconnected."""

    def pause(self) -> None:
        """Supply no points to the arm, and acknowledge no points, until `resume`.

        Invalid points are still refused, and STOP still works. The caller pauses the arm. Repeated
        calls are allowed.
        """

    def resume(self) -> None:
        """Resume after `pause`."""

    def boot(self) -> None:
        """Restart after a power cycle of the controller."""

    def tasks(self) -> Iterable[TaskRow] | None:
        """Return the tasks to display, or None to display those of condition/tasks.py."""


class CommandWindow(Program, Protocol):
    """A SPEL+ program that can also execute commands (the text of $Execute), one at a time."""

    @property
    def executes(self) -> bool:
        """Whether a command is executing."""

    def execute(self, text: str, answer: Answer) -> None:
        """Start a command, and call `answer` at its end, possibly within this call.

        Raises ProgramError if the command is invalid, RuntimeError if another one is executing.
        """

    def abort_command(self, why: str) -> None:
        """Brake and end the current command, if any."""


VERSION = (0, 2, 0)
"""Version of the built-in program in GET_VERSION replies: major, minor, patch."""

WITHOUT_WATCHDOG = (0, 1, 0)
"""Version of a program without a watchdog for a stalled motion client."""

Answers = Mapping[int, Callable[[], Message]]
"""Message type → function that returns the body of the reply to such a request."""

UNANSWERED = (CommType.TOPIC, CommType.SERVICE_REPLY)
"""Communication types of messages that are not answered."""

_log = logging.getLogger(__name__)


def failure(msg_type: int) -> Packet:
    """Return a reply with FAILURE and an empty body."""
    return reply(Opaque(msg_type), ReplyCode.FAILURE)


def answer(packet: Packet, answers: Answers) -> Packet | None:
    """Return the reply to a request, or None for topics and replies, which are not answered.

    `answers` has precedence over the default answers, except for PING.
    """
    if packet.comm_type is not CommType.SERVICE_REQUEST:
        return None
    if isinstance(packet.message, Ping):
        return reply(Ping((0,) * len(packet.message.padding)), ReplyCode.SUCCESS)
    if packet.msg_type in answers:
        return reply(answers[packet.msg_type](), ReplyCode.SUCCESS)
    if packet.msg_type == MessageType.GET_VERSION:
        return reply(GetVersion(VERSION), ReplyCode.SUCCESS)
    return failure(packet.msg_type)


def answer_frame(frame: Frame, answers: Answers) -> Packet | None:
    """Return the reply to a frame that may have an invalid header or body, see `answer`.

    Topics and replies are not answered, because two peers could otherwise answer each other
    forever.
    """
    try:
        return answer(decode(frame), answers)
    except (HeaderError, BodyError) as error:
        _log.warning('refused: %s', error)
        answered = frame.msg_type > 0 and frame.comm_type not in UNANSWERED
        return failure(frame.msg_type) if answered else None
