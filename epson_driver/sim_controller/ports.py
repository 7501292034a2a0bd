# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Interfaces of the controller's ports and programs, without sockets.

A session serves one client of a port: it receives bytes, and sends bytes with the client's `send`.
`network/port_server.py` connects sessions to sockets. Tests call sessions directly.
"""

import logging
from abc import ABC, abstractmethod
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

Send = Callable[[bytes], object]


class Session(Protocol):
    """The session of one client of a port."""

    def receive(self, data: bytes) -> None:
        """Process bytes, in any segmentation. The connection must be closed after a FrameError."""

    def closed(self) -> None:
        """End the session after its client has disconnected. Repeated calls are allowed."""


class Client(Protocol):
    """The connection to a client, as used by the sessions."""

    @property
    def local(self) -> bool:
        """Whether the client runs on the same machine as the controller."""

    def send(self, data: bytes) -> None:
        """Send bytes, or drop them if the connection is closed."""

    def close(self) -> None:
        """Close the connection once all bytes are sent."""

    def abort(self) -> None:
        """Close the connection immediately, and drop unsent bytes."""


Answer = Callable[[str | SpelError], None]
"""Function that gets the output of a statement ('' if it has none), or its error."""


class Program(ABC):
    """A program that moves the arm and answers the messages of the motion client."""

    @property
    def ready(self) -> bool:
        """Whether the program itself is ready to accept points."""
        return True

    @property
    def runs(self) -> bool:
        """Whether a SPEL+ task other than a background task runs.

        In this case the controller is not Ready.
        """
        return False

    @abstractmethod
    def receive(self, frame: Frame) -> None:
        """Execute, queue or refuse one message."""

    @abstractmethod
    def step(self, dt: float) -> None:
        """Advance the executor by `dt` ≥ 0 s and supply its points.

        If a point is done within `dt`, the program answers it, supplies the next one and advances
        by the remaining time. So the step size does not cause pauses between points.
        """

    @abstractmethod
    def abort(self) -> None:
        """Brake, and answer all unanswered points with FAILURE."""

    @abstractmethod
    def restart(self) -> None:
        """Brake, answer all points with FAILURE, and discard the trajectory."""

    def detach(self) -> None:  # noqa: B027
        """Discard the unacknowledged points of a client that has disconnected."""

    @abstractmethod
    def pause(self) -> None:
        """Supply no points to the paused arm, and acknowledge none, until `resume`.

        A STOP is still executed.
        """

    @abstractmethod
    def resume(self) -> None:
        """Resume after `pause`."""

    def boot(self) -> None:  # noqa: B027
        """Restart after a power cycle."""

    def tasks(self) -> Iterable[TaskRow] | None:
        """Return the tasks to display, or None for the tasks of condition/tasks.py."""
        return None


class CommandWindow(Program):
    """A SPEL+ program that can also execute commands, one at a time.

    A command is the text of `$Execute`.
    """

    @property
    @abstractmethod
    def executes(self) -> bool:
        """Whether a command is executing."""

    @abstractmethod
    def execute(self, text: str, answer: Answer) -> None:
        """Start a command. `answer` is called when it has ended, possibly within this call.

        Raises ProgramError if the command is invalid, RuntimeError if another command is
        executing.
        """

    @abstractmethod
    def abort_command(self, why: str) -> None:
        """Brake and end the current command, if any."""


VERSION = (0, 2, 0)  # version of the built-in program: major, minor, patch
WITHOUT_WATCHDOG = (0, 1, 0)  # version of a program without a watchdog
Answers = Mapping[int, Callable[[], Message]]
UNANSWERED = (CommType.TOPIC, CommType.SERVICE_REPLY)
_log = logging.getLogger(__name__)


def failure(msg_type: int) -> Packet:
    return reply(Opaque(msg_type), ReplyCode.FAILURE)


def answer(packet: Packet, answers: Answers) -> Packet | None:
    """Return the reply to a request, or None for topics and replies, which are not answered.

    `answers` replace the default answers, except for PING.
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
    """Return the reply to a frame, like `answer`. The header or body may be invalid.

    Topics and replies get no answer, because two peers could otherwise answer each other forever.
    """
    try:
        return answer(decode(frame), answers)
    except (HeaderError, BodyError) as error:
        _log.warning('refused: %s', error)
        answered = frame.msg_type > 0 and frame.comm_type not in UNANSWERED
        return failure(frame.msg_type) if answered else None
