# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A SPEL+ program on the simulated controller. It replaces the built-in programs.

The tasks run on the controller's clock. Any event that may affect a task (bytes, the end of a
motion, a button) sets a timer that is due immediately, and only this timer runs the tasks. So they
never run while the controller's state changes.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from epson_driver.sim_controller.arm.point_to_point import PointToPoint
from epson_driver.sim_controller.clock import Timer
from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.sim_controller.condition.states import ENDED, Event, RejectedError, Tasks
from epson_driver.sim_controller.condition.tasks import (
    STATE_WORDS,
    TYPE_WORDS,
    TaskRow,
)
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.io.io_points import IoError
from epson_driver.sim_controller.ports import Answer, CommandWindow
from epson_driver.sim_controller.spel_host.motion_statements import points_of
from epson_driver.sim_controller.spel_host.program_network import ProgramNetwork
from epson_driver.sim_controller.spel_host.robot_commands import command
from epson_driver.sim_controller.spel_host.robot_motion import Motion, RobotMotion
from epson_driver.sim_controller.spel_host.robot_points import RobotPoints
from epson_driver.sim_controller.spel_host.robot_values import RobotContext, value
from epson_driver.sim_controller.spel_host.terminals import LogTerminal
from epson_driver.simple_message import Frame, IoType
from epson_driver.spel import (
    Array,
    Completion,
    Machine,
    Memory,
    MotionRequest,
    Point,
    Program,
    ProgramEnvironment,
    SpelError,
    TaskError,
    TaskState,
    TaskType,
    TaskView,
    Terminal,
    Timing,
    Value,
)
from epson_driver.spel import ErrorNumber as SpelNumber
from epson_driver.spel.task import COMMAND_TASK, FIRST_BACKGROUND, LAST_BACKGROUND, Task, printed

MAIN, BACKGROUND = 'main', 'bgmain'
STANDSTILL_POLL_S = 0.004  # polling period after a command that moved the arm, s

_TRAP_EVENTS = {Tasks.PAUSED: 'pause', Tasks.INTERRUPTED: 'sgopen', Tasks.WAIT_RECOVER: 'sgclose'}
"""State of the paused tasks → name of the Trap event."""

MOTION_ERRORS = range(4000, 6000)
"""Numbers of motion errors. For these errors, `Trap Error` gets the robot number 1 (SPEL+ manual
p856)."""

ROUNDING_S = 1e-9
"""Maximum rounding error of the interpreter's time, which counts from the boot, s."""

POLL_PERIOD_S = 0.010  # polling period for statements whose end causes no event, s

_IO = {
    Memory.INPUT: IoType.DIGITAL_INPUT,
    Memory.OUTPUT: IoType.DIGITAL_OUTPUT,
    Memory.MEMORY: IoType.FLAG,
}

_log = logging.getLogger(__name__)


class SpelSource(NamedTuple):
    """A SPEL+ program, its ports, and its terminal (None: the output is logged).

    `environment`: stub answers, port settings and files of the program (None: the defaults).
    `starts`: the function to start. If it is not main, BgMain is not started.
    """

    program: Program
    network: ProgramNetwork
    terminal: Terminal | None = None
    environment: ProgramEnvironment | None = None
    starts: str = MAIN


def _nothing() -> None:
    pass


class SpelProgram(CommandWindow):
    """A SPEL+ program, which moves the arm and serves the ports that it opens.

    The function main is started at boot and by an operator, BgMain at boot. An operator's start
    clears the global variables unless the program has a BgMain, which may share them.

    `acquire_arm` is called before a motion to get control of the arm. It may raise SpelError.
    Raises ProgramError if the program has statements that are not simulated.
    """

    def __init__(
        self,
        controller: Controller,
        arm: PointToPoint,
        source: SpelSource,
        acquire_arm: Callable[[], None] = _nothing,
    ) -> None:
        self._program = program = source.program
        self._starts = source.starts.lower()
        self._background = program.by_name.get(BACKGROUND) if self._starts == MAIN else None
        self.failure: TaskError | None = None  # first failure since the start of the program
        self._controller = controller
        self._arm = arm
        self.network = source.network
        self._environment = source.environment
        self._timing = Timing()
        self._motion = RobotMotion(arm, controller.clock, self._soon, self._timing.scan)
        self._acquire_arm = acquire_arm
        self._robot = RobotContext(controller, self._motion, RobotPoints(controller.model))
        self.terminal = source.terminal or LogTerminal(controller.clock)
        self._timer: Timer | None = None
        self._running = False
        self._later: list[Callable[[], None]] = []
        self._starting = True  # main must be started
        self._finishing = False
        self._ended = False  # whether the tasks have ended, until a person starts the program
        self._mover: Task | None = None  # the task whose motion is executing
        self._answer: Answer | None = None  # gets the result of the current command
        self._output: list[str] = []  # output of the current command
        self._command_error: SpelError | None = None
        self._command_moved = False
        self._standstill_timer: Timer | None = None
        self.network.news = self._soon
        self.machine, self._start_time = self._new_machine()

    def _new_machine(self) -> tuple[Machine, float]:
        machine = Machine(self._program, self, self._timing, around=self._environment)
        if self._background is not None:
            machine.start_background(self._background.name)
        self._soon()
        return machine, self._controller.clock.now

    # Time

    def _soon(self) -> None:
        """Run the tasks as soon as the current call of the controller has returned."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._controller.clock.after(0.0, self._run)

    def _run(self) -> None:
        self._timer = None
        now = self._pass_time()
        self._start_main()
        self._running = True
        try:
            # A command must start now, even if the tasks' time is some microseconds ahead.
            self.machine.advance(max(now, self.machine.time) if self.executes else now)
        finally:
            self._running = False
        while self._later:
            self._later.pop(0)()
        self._check_tasks()
        due = self.machine.next_time()
        if self._timer is None and due is not None:
            self._timer = self._controller.clock.after(max(due - now, 0.0), self._run)

    def _now(self) -> float:
        """Return the time since the boot, s.

        If an event is due within ROUNDING_S, return its time, because the clock has rounding
        errors.
        """
        now = self._controller.clock.now - self._start_time
        due = self.machine.next_time()
        return due if due is not None and now < due < now + ROUNDING_S else now

    def _pass_time(self) -> float:
        """Advance the idle interpreter to now, so that new delays start now. Return the time."""
        now = self._now()
        self.machine.idle(now)
        return now

    def _after_tasks(self, action: Callable[[], None]) -> None:
        """Call `action` now. If `_run` is executing, call it at the end of `_run`."""
        if self._running:
            self._later.append(action)
        else:
            self._pass_time()
            action()
            self._soon()

    def _start_main(self) -> None:
        if not self._starting or self._controller.condition.tasks is not Tasks.RUNNING:
            return
        self._starting = False
        self.failure = None
        main = self._program.by_name.get(self._starts)
        if main is None:
            return
        try:
            self.machine.start(main.name, clear=self._background is None)
        except SpelError as error:
            _log.error('main is not started: %s', error)
            self._controller.raise_error(error.number)

    def _check_tasks(self) -> None:
        mover = self._mover
        if self._motion.busy and (mover is None or mover.frame is None):
            self._motion.abort(_aborted('its task has ended'))
        self._check_command()
        condition = self._controller.condition
        own = self._controller.program is self
        if own and not self.runs and condition.tasks is Tasks.RUNNING:
            if self.machine.last_event('finish'):
                self._soon()
                return
            self._finishing = True
            self._controller.apply(Event.TASKS_FINISHED)
            self._finishing = False

    def _alive(self) -> Iterator[TaskView]:
        return (
            task
            for task in self.machine.tasks()
            if task.state is not TaskState.ABORTED and task.number != COMMAND_TASK
        )

    # The command window

    @property
    def executes(self) -> bool:
        return self._answer is not None

    def execute(self, text: str, answer: Answer) -> None:
        if self.executes:
            raise RuntimeError('a command is being executed')
        self._pass_time()
        self._output = self.machine.execute(text)
        self._answer, self._command_error, self._command_moved = answer, None, False
        if self._timer is not None:
            self._timer.cancel()
        self._run()

    def abort_command(self, why: str) -> None:
        task = self.machine.world.tasks.get(COMMAND_TASK)
        if task is None:
            return
        self._command_error = SpelError(ErrorNumber.MOTION_ABORTED, why)
        self.machine.world.end(task)
        self._soon()

    def _check_command(self) -> None:
        """Answer a command that has ended.

        If the command moved the arm, the answer waits until the arm is at rest.
        """
        answer = self._answer
        if answer is None or COMMAND_TASK in self.machine.world.tasks:
            return
        if self._command_moved and self._controller.in_motion:
            if self._standstill_timer is None:
                self._standstill_timer = self._controller.clock.every(
                    STANDSTILL_POLL_S, self._check_command
                )
            return
        if self._standstill_timer is not None:
            self._standstill_timer.cancel()
            self._standstill_timer = None
        self._answer = None
        answer(printed(self._output) if self._command_error is None else self._command_error)

    # Interface for the controller (Program)

    @property
    def runs(self) -> bool:
        return self._starting or any(
            task.type is not TaskType.BACKGROUND for task in self._alive()
        )

    @property
    def main_runs(self) -> bool:
        return self._starting or 1 in self.machine.world.tasks

    def receive(self, frame: Frame) -> None:
        raise RuntimeError(f'a SPEL+ program accepts no frame ({frame.msg_type})')

    def step(self, dt: float) -> None:
        time_left = self._arm.step(dt)
        while time_left is not None and time_left > 0.0 and self._arm.moving:
            time_left = self._arm.step(time_left)
        self._motion.update()

    def abort(self) -> None:
        """Brake because the motors are off. The task that moves the arm gets the error 2999."""
        self._motion.abort(_aborted('the motors went off'))
        self._soon()

    def restart(self) -> None:
        if not self._finishing:  # a Go … CP at the end of the program is completed
            self._motion.abort(_aborted('the tasks were stopped'))
        aborted = self._controller.condition.tasks is Tasks.ABORTED
        self._starting = False
        self._ended = True

        def end() -> None:
            self.abort_command('the command was aborted: the tasks were stopped')
            if aborted:
                number = self._controller.error_number
                if self._controller.condition.estopped:
                    self.machine.event('emergency')
                else:
                    self.machine.event('error', number, int(number in MOTION_ERRORS))
                self.machine.emergency_stop()
            else:
                self.machine.stop()
                self.machine.last_event('abort')

        self._after_tasks(end)

    def boot(self) -> None:
        """Restart the program. Only preserved variables keep their values."""
        self.abort_command('the command was aborted: the controller was switched off')
        self._after_tasks(self._boot)

    def _boot(self) -> None:
        preserved_values = self.machine.preserved()
        self._motion.abort(_aborted('the controller was switched off'))
        self.network.close_all()
        self.machine, self._start_time = self._new_machine()
        self.machine.restore(preserved_values)
        self._starting, self._ended = True, False
        self._soon()

    def pause(self) -> None:
        """Pause the Normal tasks.

        Also start the Trap task for a pause or for the open door, if the program has one.
        """
        event = _TRAP_EVENTS.get(self._controller.condition.tasks)

        def pause_tasks() -> None:
            self.machine.pause()
            if event is not None:
                self.machine.event(event)

        self._after_tasks(pause_tasks)

    def resume(self) -> None:
        """Resume the paused tasks, or start main if the tasks had ended."""
        tasks = self._controller.condition.tasks
        if tasks in ENDED:
            if tasks is Tasks.STOPPED:  # possibly by a reset
                self._after_tasks(self.machine.clear_errors)
            return
        if self._ended:
            self._ended = False
            self._starting = not self._running  # not if StartMain is starting it
        self._motion.update()
        self._after_tasks(self.machine.resume)

    def tasks(self) -> Iterator[TaskRow]:
        for task in self.machine.tasks():
            state = f'{STATE_WORDS[task.state]} {_plain(task.file)}:{task.line}'
            yield TaskRow(task.number, task.function, TYPE_WORDS[task.type], state)

    # Interface for the interpreter (Host)

    def read_bits(self, memory: Memory, index: int, width: int) -> int:
        try:
            return self._controller.io.read_port(_IO[memory], index, width)
        except IoError as error:
            raise SpelError(SpelNumber.ARGUMENT, str(error)) from error

    def write_bits(self, memory: Memory, index: int, width: int, value: int) -> None:
        """Set a bit or a port of inputs, outputs or memory.

        Raises SpelError if the index or the value is invalid.
        """
        io = self._controller.io
        try:
            if memory is Memory.INPUT:
                io.set_input_port(index, width, value)
            else:
                io.write_port(_IO[memory], index, width, value)
        except IoError as error:
            raise SpelError(SpelNumber.ARGUMENT, str(error)) from error

    def value(self, name: str, arguments: Sequence[int | float | Point]) -> float | Point | str:
        return value(self._robot, name, arguments)

    def command(
        self, name: str, arguments: Sequence[Value | Point | None], words: tuple[str, ...]
    ) -> Completion | None:
        """Execute a statement. Return its progress if it takes time, or None."""
        if name == 'home':
            return self.move(MotionRequest(name, ()))
        completion = command(self._robot, name, arguments, words)
        if completion is not None and not completion.done:
            self._poll(completion)
        return completion

    def _poll(self, completion: Completion) -> None:
        timer: Timer

        def poll() -> None:
            if completion.done:
                timer.cancel()
                self._soon()

        timer = self._controller.clock.every(POLL_PERIOD_S, poll, first=POLL_PERIOD_S)

    def move(self, request: MotionRequest) -> Motion:
        controller, commanded = self._controller, self.machine.running_number == COMMAND_TASK
        rejection = controller.command_rejection() if commanded else controller.motion_rejection()
        if rejection is not None:
            raise SpelError(rejection.number, rejection.sentence)
        self._acquire_arm()
        motion = self._motion.execute(request, points_of(self._robot, request))
        self._mover, self._command_moved = self.machine.running, commanded
        return motion

    def stored_point(self, point: Point) -> Point:
        return self._robot.points.stored(point)

    def call_library(
        self, library: str, name: str, _arguments: Sequence[Value | Array]
    ) -> int | float:
        raise SpelError(SpelNumber.NO_LIBRARY, f'{name} of {library}')

    def task_failed(self, error: TaskError) -> None:
        """Raise an error of the controller. It is critical if a background task failed."""
        if error.task == COMMAND_TASK:
            self._command_error = SpelError(error.number, error.text)
            return
        critical = FIRST_BACKGROUND <= error.task <= LAST_BACKGROUND
        _log.error('%s', error)
        self.failure = self.failure or error
        report = error.details
        self._later.append(lambda: self._controller.raise_error(error.number, critical, report))
        self._soon()

    def paused(self, on: bool) -> None:
        """Apply Pause (`on`) or Cont of the program, once the tasks have run."""
        self._later.append(lambda: self._apply(Event.PAUSE if on else Event.CONTINUE))

    def _apply(self, event: Event) -> None:
        try:
            self._controller.apply(event)
        except RejectedError as error:
            _log.warning('the program requests %s: %s', event.value, error)


def _plain(name: str) -> str:
    """Return a file name without the characters that separate the parts of an answer."""
    return ''.join('_' if item in ',;=' or not item.isprintable() else item for item in name)


def _aborted(why: str) -> SpelError:
    return SpelError(ErrorNumber.MOTION_ABORTED, f'the motion was aborted: {why}')
