# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The host of a SPEL+ program in the simulated controller: motion, I/O, ports, console."""

from collections.abc import Callable, Sequence

from epson_driver.sim_controller.clock import Timer
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

LOOK_S = 0.010
"""Polling period for the end of statements without an event, s."""

_IO = {
    Memory.INPUT: IoType.DIGITAL_INPUT,
    Memory.OUTPUT: IoType.DIGITAL_OUTPUT,
    Memory.MEMORY: IoType.FLAG,
}


class SpelHost:
    """The host of a program's interpreter.

    `news` is called when a task may continue, and `failed` with the error that ended a task.
    `pauses` is called for the program's Pause (True) or Cont (False), and `moves` when a task has
    started a motion. `commanded` returns whether the command window is the caller.
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
        """Return a bit or a port. Raises SpelError."""
        try:
            return self._controller.io.read_port(_IO[memory], index, width)
        except IoError as error:
            raise SpelError(ErrorNumber.ARGUMENT, str(error)) from error

    def write_bits(self, memory: Memory, index: int, width: int, value: int) -> None:
        """Set a bit or a port, or an input with virtual I/O. Raises SpelError."""
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
        """Return the value of a controller or robot function. Raises SpelError."""
        return value(self._robot, name, arguments)

    def command(
        self, name: str, arguments: Sequence[Value | Point | None], words: tuple[str, ...]
    ) -> Completion | None:
        """Execute a statement that sets up the robot. Raises SpelError."""
        if name in MOVING:
            given = zip(('joint', 'step'), arguments, strict=False)
            numbers = {key: float(value) for key, value in given if isinstance(value, int | float)}
            return self.move(MotionRequest(name, (), numbers=numbers))
        completion = command(self._robot, name, arguments, words)
        if completion is not None and not completion.done:
            self._look(completion)
        return completion

    def _look(self, completion: Completion) -> None:
        """Notify the tasks when a statement without an event is over."""
        timer: Timer

        def look() -> None:
            if completion.done:
                timer.cancel()
                self._news()

        timer = self._controller.clock.every(LOOK_S, look, first=LOOK_S)

    def move(self, request: MotionRequest) -> Motion:
        """Start a motion. Raises SpelError."""
        controller = self._controller
        rejection = (
            controller.command_rejection() if self._commanded() else controller.motion_rejection()
        )
        if rejection is not None:
            raise SpelError(rejection.number, rejection.sentence)
        self._robot.motion.claim()
        motion = self._robot.motion.begin(request, points_of(self._robot, request))
        self._moves()
        return motion

    def stored_point(self, point: Point) -> Point:
        """Return a point as stored in P0, P1, …."""
        return self._robot.points.stored(point)

    # Notifications of tasks

    def call_library(
        self, library: str, name: str, _arguments: Sequence[Value | Array]
    ) -> int | float:
        """Raise the error of a missing library, because no PC with a DLL exists."""
        raise SpelError(ErrorNumber.NO_LIBRARY, f'{name} of {library}')

    def task_failed(self, error: TaskError) -> None:
        """Report that an error ended a task."""
        self._failed(error)

    def paused(self, on: bool) -> None:
        """Report that a program requested Pause or Cont."""
        self._pauses(on)
