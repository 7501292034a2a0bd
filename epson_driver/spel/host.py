# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The interface between a program and its environment: robot, I/O, ports, terminal.

The interpreter calls the host, which answers immediately and never blocks. An operation that takes
time returns a Completion, or a result that changes later. Tasks that wait for such an operation
are checked whenever the machine advances, so the host calls `machine.advance(now)` after each
event.

A host raises SpelError where a controller would report an error. The calling task gets it at the
current statement.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

from epson_driver.spel.errors import SpelError, TaskError
from epson_driver.spel.values import Array, Point, Value


class Memory(Enum):
    """The kinds of bits that can be read and written."""

    INPUT = 'input'
    OUTPUT = 'output'
    MEMORY = 'memory'


class Completion(Protocol):
    """An operation that takes time: a motion, or the switching of the motors."""

    @property
    def fraction(self) -> float:
        """Return the completed fraction of the path, 0 to 1.

        It is -1 in a Jump until the horizontal move starts, so that parallel statements (`!…!`) do
        not start during the lift.
        """

    @property
    def done(self) -> bool:
        """Return whether the statement is complete.

        With `CP` it is complete when the deceleration starts.
        """

    @property
    def error(self) -> SpelError | None:
        """Return the error of a completed operation, or None."""


@dataclass(frozen=True, slots=True)
class NetSettings:
    """Settings of a port (`SetNet`). `timeout`, s, applies to sending and receiving."""

    host: str
    tcp_port: int
    terminator: str = '\r\n'
    timeout: float = 0.0


@dataclass(frozen=True, slots=True)
class MotionRequest:
    """A statement that moves the arm, with its arguments.

    * name: in lower case ('go', 'move', …).
    * points: the targets of the motion in order.
    * cp: whether the motion may blend into the next motion.
    * till: once it returns True, the arm decelerates, and the statement ends without an error. The
      host evaluates it at each scan, and ends the motion with any SpelError that it raises.
    * find: when it first returns True, the position of the arm is stored.
    * sense: if it returns True above the target of a Jump, the Jump ends there.
    * words: other modifiers, such as 'rot'.
    * numbers: the values of 'c' (number of the arch), 'limz' (mm), 'ljm' and 'performmode'. Of an
      arch: 'depart' and 'approach' (mm). Of an arc: 'angle' (degrees), 'radius' (mm), 'path' and
      'direction' (SPEL+ manual p104). Of JumpTLZ: 'tlz' (mm).
    """

    name: str
    points: tuple[Point, ...]
    cp: bool = False
    till: Callable[[], bool] | None = None
    find: Callable[[], bool] | None = None
    sense: Callable[[], bool] | None = None
    words: tuple[str, ...] = ()
    numbers: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Caller:
    """The task that calls the host: number, current function, and position in the source."""

    task: int
    function: str
    file: str
    line: int


class Terminal(Protocol):
    """The window that displays the output of Print and reads the lines of Input."""

    def write(self, caller: Caller, text: str) -> None:
        """Show a text whose lines end with a line feed."""

    def read_line(self) -> str | None:
        """Return a line that a user has typed, or None before the next line is typed."""

    def message_box(self, caller: Caller, text: str, buttons: int, title: str) -> int | None:
        """Return the number of the pressed button, or None before a button is pressed.

        The interpreter calls it repeatedly until a button is pressed.
        """


class Network(Protocol):
    """Ports 201 to 216 of SPEL+. The interpreter checks which task may use a port."""

    def open_net(self, port: int, settings: NetSettings, server: bool) -> None:
        """Listen or connect, without waiting for the peer. Raises SpelError if this fails."""

    def close_net(self, port: int) -> None:
        """Close a port if it is open."""

    def release_owner(self, port: int) -> None:
        """Refuse new peers of a port, because the task that opened it has ended."""

    def connected(self, port: int) -> bool:
        """Return whether an open port has a peer."""

    def received(self, port: int) -> bytes:
        """Return the unread received bytes, even after the peer has disconnected."""

    def take(self, port: int, count: int) -> bytes:
        """Remove and return the first `count` received bytes."""

    def send(self, port: int, data: bytes) -> None:
        """Send `data`. Raises SpelError 2902 if the peer has disconnected."""


class Host(Protocol):
    """The complete host: bits, the arm and its settings, terminal, ports, and events of tasks."""

    def read_bits(self, memory: Memory, index: int, width: int) -> int:
        """Return bit (width 1), byte (8) or word (16) number `index`.

        Raises SpelError if it does not exist.
        """

    def write_bits(self, memory: Memory, index: int, width: int, value: int) -> None:
        """Set bit (width 1), byte (8) or word (16) number `index`.

        Raises SpelError if it does not exist.
        """

    def value(self, name: str, arguments: Sequence[int | float | Point]) -> float | Point | str:
        """Return the value of a function ('agl', 'realpls', 'ctrlinfo', 'cx', …, in lower case).

        Some functions return -1 for True, others 1. Raises SpelError if the controller refuses the
        call.
        """

    def command(
        self, name: str, arguments: Sequence[Value | Point | None], words: tuple[str, ...]
    ) -> Completion | None:
        """Execute a statement by its name in lower case ('motor', 'power', 'speed', 'reset', …).

        Returns the operation to wait for, or None if the statement is complete. `words` are its
        keywords in lower case ('on', 'high'). 'quit all' resets Speed, Accel and others to their
        initial values and sets low power. 'startmain' precedes the start of main. Raises SpelError
        if the controller refuses the statement.
        """

    def move(self, request: MotionRequest) -> Completion:
        """Start a motion.

        Raises SpelError if the motion is refused, with the number 4001 for a target out of range.
        """

    def stored_point(self, point: Point) -> Point:
        """Return a point as a point variable (P0, P1) stores it.

        Angles and pulses are converted to a pose.
        """

    @property
    def terminal(self) -> Terminal:
        """Return the terminal that the statements Print, Input and MsgBox use."""

    @property
    def network(self) -> Network:
        """Return the interface to the network ports."""

    def call_library(
        self, library: str, name: str, arguments: Sequence[Value | Array]
    ) -> int | float:
        """Call a function of a DLL. Raises SpelError 2473 if the library is not available.

        The function may write to arrays. A ByRef argument is passed as an array of one element.
        """

    def task_failed(self, error: TaskError) -> None:
        """Record that a task ended with an unhandled error."""

    def paused(self, on: bool) -> None:
        """Record that a program executed `Pause` (`on` is True) or `Cont` (False).

        After Cont the host resumes the tasks (`Machine.resume`) as soon as it can.
        """
