# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The host of a SPEL+ interpreter in the simulated controller: motion, I/O, ports, terminal."""

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Final

from epson_driver.sim_controller.clock import Clock, Timer
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.io.io_points import IoError
from epson_driver.sim_controller.spel_host.motion_statements import points_of
from epson_driver.sim_controller.spel_host.program_network import ProgramNetwork
from epson_driver.sim_controller.spel_host.robot_commands import command
from epson_driver.sim_controller.spel_host.robot_motion import Motion
from epson_driver.sim_controller.spel_host.robot_values import RobotContext, value
from epson_driver.simple_message import IoType
from epson_driver.spel import (
    Array,
    Caller,
    Completion,
    ErrorNumber,
    Memory,
    MotionRequest,
    Point,
    SpelError,
    TaskError,
    Terminal,
    Value,
)
from epson_driver.spel.commands import MOVING

CANCEL: Final = 2
"""The answer to a MsgBox, because no user is present."""

MAX_LINE = 1000
"""Maximum length of a printed line, characters. A longer line is truncated."""

_terminal = logging.getLogger('epson_driver.spel.terminal')


class Unattended(ABC):
    """A terminal without a user. It has no input, and every MsgBox is answered with Cancel."""

    @abstractmethod
    def write(self, caller: Caller, text: str) -> None:
        """Show a text."""

    def read_line(self) -> str | None:
        """Return None, because no input exists."""
        return None

    def message_box(self, caller: Caller, text: str, _buttons: int, title: str) -> int | None:
        """Show the text and answer Cancel."""
        self.write(caller, f'MsgBox {title}: {text} (answered with Cancel)\n')
        return CANCEL


class KeptText(Unattended):
    """A terminal that stores the printed text."""

    def __init__(self) -> None:
        self.printed: list[str] = []

    def write(self, _caller: Caller, text: str) -> None:
        """Store a printed text."""
        self.printed.append(text)


class LogTerminal(Unattended):
    """A terminal that logs each printed line with the controller's time, task and function."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._lines: dict[int, str] = {}

    def write(self, caller: Caller, text: str) -> None:
        """Log all complete lines of the printed text."""
        *lines, rest = (self._lines.pop(caller.task, '') + text).split('\n')
        for line in lines:
            self._show(caller, line)
        if len(rest) > MAX_LINE:
            self._show(caller, rest)
        elif rest:
            self._lines[caller.task] = rest

    def _show(self, caller: Caller, line: str) -> None:
        # The record has the file and line of the Print, so each Print has a separate rate limit.
        what = '%9.3f s task %d %s: %s'
        values = (self._clock.now, caller.task, caller.function, line[:MAX_LINE])
        record = _terminal.makeRecord(
            _terminal.name, logging.INFO, caller.file, caller.line, what, values, None
        )
        if _terminal.isEnabledFor(logging.INFO):
            _terminal.handle(record)


POLL_PERIOD_S = 0.010
"""Period for polling statements whose end causes no event, s."""

_IO = {
    Memory.INPUT: IoType.DIGITAL_INPUT,
    Memory.OUTPUT: IoType.DIGITAL_OUTPUT,
    Memory.MEMORY: IoType.FLAG,
}


class SpelHost:
    """Connects the interpreter of a SPEL+ program with the controller.

    * `news`: called when a task may continue.
    * `failed`: called with the error that ended a task.
    * `pauses`: called with True for the program's Pause, and with False for Cont.
    * `moves`: called when a task has started a motion.
    * `commanded`: returns whether a statement of `$Execute` is executing.
    """

    def __init__(
        self,
        controller: Controller,
        robot: RobotContext,
        network: ProgramNetwork,
        terminal: Terminal,
        news: Callable[[], None],
        failed: Callable[[TaskError], None],
        pauses: Callable[[bool], None],
        moves: Callable[[], None],
        commanded: Callable[[], bool],
    ) -> None:
        self._controller = controller
        self._robot = robot
        self.network = network
        self.terminal = terminal
        self._news = news
        self._failed = failed
        self._pauses = pauses
        self._moves = moves
        self._commanded = commanded

    # Inputs, outputs, memory

    def read_bits(self, memory: Memory, index: int, width: int) -> int:
        """Return the value of a bit or a port. Raises SpelError if it does not exist."""
        try:
            return self._controller.io.read_port(_IO[memory], index, width)
        except IoError as error:
            raise SpelError(ErrorNumber.ARGUMENT, str(error)) from error

    def write_bits(self, memory: Memory, index: int, width: int, value: int) -> None:
        """Set a bit or a port, including inputs. Raises SpelError if index or value is invalid."""
        io = self._controller.io
        try:
            if memory is Memory.INPUT:
                io.set_input_port(index, width, value)
            else:
                io.write_port(_IO[memory], index, width, value)
        except IoError as error:
            raise SpelError(ErrorNumber.ARGUMENT, str(error)) from error

    # The robot

    def value(self, name: str, arguments: Sequence[int | float | Point]) -> float | Point | str:
        """Return the value of a SPEL+ function. Raises SpelError if it has no value."""
        return value(self._robot, name, arguments)

    def command(
        self, name: str, arguments: Sequence[Value | Point | None], words: tuple[str, ...]
    ) -> Completion | None:
        """Execute a statement for the robot. Return its progress if it takes time, or None.

        Raises SpelError if an argument is invalid or the controller refuses the statement.
        """
        if name in MOVING:
            named = zip(('joint', 'step'), arguments, strict=False)
            numbers = {key: float(value) for key, value in named if isinstance(value, int | float)}
            return self.move(MotionRequest(name, (), numbers=numbers))
        completion = command(self._robot, name, arguments, words)
        if completion is not None and not completion.done:
            self._poll(completion)
        return completion

    def _poll(self, completion: Completion) -> None:
        """Poll a statement whose end causes no event, and call `news` when it ends."""
        timer: Timer

        def poll() -> None:
            if completion.done:
                timer.cancel()
                self._news()

        timer = self._controller.clock.every(POLL_PERIOD_S, poll, first=POLL_PERIOD_S)

    def move(self, request: MotionRequest) -> Motion:
        """Start a motion. Raises SpelError if it is invalid or the arm cannot move now."""
        controller = self._controller
        rejection = (
            controller.command_rejection() if self._commanded() else controller.motion_rejection()
        )
        if rejection is not None:
            raise SpelError(rejection.number, rejection.sentence)
        self._robot.motion.acquire_arm()
        motion = self._robot.motion.execute(request, points_of(self._robot, request))
        self._moves()
        return motion

    def stored_point(self, point: Point) -> Point:
        """Return a point as stored in P0, P1, …."""
        return self._robot.points.stored(point)

    # Notifications of tasks

    def call_library(
        self, library: str, name: str, _arguments: Sequence[Value | Array]
    ) -> int | float:
        """Raise SpelError, because the simulation has no PC with libraries (DLLs)."""
        raise SpelError(ErrorNumber.NO_LIBRARY, f'{name} of {library}')

    def task_failed(self, error: TaskError) -> None:
        """Report that an error ended a task."""
        self._failed(error)

    def paused(self, on: bool) -> None:
        """Report that the program requested Pause (`on`) or Cont."""
        self._pauses(on)
