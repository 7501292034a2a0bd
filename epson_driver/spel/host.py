# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a program needs of the world it runs in: robot, inputs and outputs, ports, terminal.

The interpreter asks; the host answers at once and never blocks. What takes time is a Completion,
or an answer that changes later: a task that waits for one is looked at again whenever the machine
is advanced, so a host that has news calls `machine.advance(now)`.

A host raises SpelError for what a controller would answer with an error; the task that asked gets
it at that statement.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

from epson_driver.spel.errors import SpelError, TaskError
from epson_driver.spel.values import Array, Point, Value


class Memory(Enum):
    """What bits can be read from and written to."""

    INPUT = 'input'
    OUTPUT = 'output'
    MEMORY = 'memory'


class Completion(Protocol):
    """Something that takes time: a motion, motors being switched."""

    @property
    def share(self) -> float:
        """Return how much of it is done, 0 to 1, or less where !…! has to wait."""

    @property
    def done(self) -> bool:
        """Return whether the statement is over: for CP, when the deceleration begins."""

    @property
    def error(self) -> SpelError | None:
        """Return how it failed, if it did, once it is done."""


@dataclass(frozen=True, slots=True)
class NetSettings:
    """SetNet, with the terminator of lines, and the timeout of sending and receiving, s."""

    host: str
    tcp_port: int
    terminator: str = '\r\n'
    timeout: float = 0.0


@dataclass(frozen=True, slots=True)
class MotionRequest:
    """A statement that moves the arm.

    `name` in lower case ('go', 'move', …); `points` its targets in order; `cp` whether it may
    blend into the next one. `till`: the arm decelerates once it returns true, the statement is
    over without an error; the host asks at each scan, and ends the motion with the SpelError that
    the question may raise. `find`: where the arm is once it holds is kept; `sense`: a Jump ends
    above its target if it holds there. `words` are other modifiers ('rot'), `numbers` the values
    of 'c', 'limz' (mm), 'ljm' and 'performmode', of the arch 'depart' and 'approach' (mm), of an
    arc 'angle' (degrees), 'radius' (mm), 'path' and 'direction' (p104), of JumpTLZ 'tlz' (mm).
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
    """Which task asks: its number, its function, and where it is."""

    task: int
    function: str
    file: str
    line: int


class Terminal(Protocol):
    """The window that Print writes to and Input reads from."""

    def write(self, caller: Caller, text: str) -> None:
        """Show a text whose lines end with a line feed."""

    def read_line(self) -> str | None:
        """Return a line that a person has typed, or None while there is none."""

    def message_box(self, caller: Caller, text: str, buttons: int, title: str) -> int | None:
        """Return the number of the button that was pressed, or None as long as there is none.

        It is asked again until there is one.
        """


class Network(Protocol):
    """Ports 201 to 216 as SPEL+ sees them. Who may use a port, the interpreter knows."""

    def open_net(self, port: int, settings: NetSettings, server: bool) -> None:
        """Listen, or connect. Does not wait for the peer. Raises SpelError."""

    def close_net(self, port: int) -> None:
        """Close a port if it is open."""

    def orphan_net(self, port: int) -> None:
        """Be told that the task which opened a port has ended: nobody answers a new peer."""

    def connected(self, port: int) -> bool:
        """Return whether an open port has a peer."""

    def received(self, port: int) -> bytes:
        """Return what has come and is not yet taken, even from a peer that is gone."""

    def take(self, port: int, count: int) -> bytes:
        """Take the first bytes of what has come."""

    def send(self, port: int, data: bytes) -> None:
        """Send. Raises SpelError 2902 when the peer is gone."""


class Bits(Protocol):
    """Inputs, outputs and memory bits."""

    def read_bits(self, memory: Memory, index: int, width: int) -> int:
        """Return bit (width 1), byte (8) or word (16) number `index`. Raises SpelError."""

    def write_bits(self, memory: Memory, index: int, width: int, value: int) -> None:
        """Set bit, byte or word number `index`. Raises SpelError."""


class Robot(Protocol):
    """The arm, its motors and its settings, and what the controller says of itself."""

    def value(self, name: str, arguments: Sequence[int | float | Point]) -> float | Point | str:
        """Return a function by its name in lower case ('agl', 'realpls', 'ctrlinfo', 'cx', …).

        Truth is -1 or 1, as the function has it. Raises SpelError.
        """

    def command(
        self, name: str, arguments: Sequence[Value | Point | None], words: tuple[str, ...]
    ) -> Completion | None:
        """Execute a statement by its name in lower case ('motor', 'power', 'speed', 'reset', …).

        'quit all' is one too: Speed, Accel and others are as after a start, the power is low. So
        is 'startmain', before main is started: it may be refused.
        `words` are those that stood in it, in lower case ('on', 'high'). None: done at once.
        Raises SpelError.
        """

    def move(self, request: MotionRequest) -> Completion:
        """Begin a motion. Raises SpelError (4031: motors off, 4001: out of range, …)."""

    def stored_point(self, point: Point) -> Point:
        """Return a point as P0, P1, … would hold it: angles become a place in space."""


class Host(Bits, Robot, Protocol):
    """All of it, and what happens to tasks."""

    @property
    def terminal(self) -> Terminal:
        """Return what Print, Input and MsgBox use."""

    @property
    def network(self) -> Network:
        """Return the ports."""

    def call_library(
        self, library: str, name: str, arguments: Sequence[Value | Array]
    ) -> int | float:
        """Call a function of a DLL. Raises SpelError 2473.

        Arrays may be written to; what is handed over ByRef is an array of one element.
        """

    def task_failed(self, error: TaskError) -> None:
        """Be told that a task ended by an error that it did not handle."""

    def paused(self, on: bool) -> None:
        """Be told that a program asked for Pause, or for Cont (False).

        After Cont the host has the tasks go on (`Machine.resume`) as soon as it allows that.
        """
