# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A SPEL+ program on the simulated controller. It replaces the built-in programs.

The tasks run on the controller's clock. Any event that may affect a task (bytes, the end of a
motion, a button) sets a timer that is due immediately, and only this timer runs the tasks. So they
never run while the controller's state changes.
"""

import logging
from collections.abc import Callable, Iterator

from epson_driver.sim_controller.arm.point_to_point import PointToPoint
from epson_driver.sim_controller.clock import Timer
from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.sim_controller.condition.states import ENDED, Event, RejectedError, Tasks
from epson_driver.sim_controller.condition.tasks import TaskRow
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.ports import Answer
from epson_driver.sim_controller.spel_host.program_network import ProgramNetwork
from epson_driver.sim_controller.spel_host.robot_motion import RobotMotion
from epson_driver.sim_controller.spel_host.robot_points import RobotPoints
from epson_driver.sim_controller.spel_host.robot_values import RobotContext
from epson_driver.sim_controller.spel_host.spel_host import LogTerminal, SpelHost
from epson_driver.simple_message import Frame
from epson_driver.spel import (
    Machine,
    Program,
    ProgramEnvironment,
    SpelError,
    TaskError,
    TaskState,
    TaskType,
    TaskView,
    Terminal,
    Timing,
)
from epson_driver.spel.task import COMMAND_TASK, FIRST_BACKGROUND, LAST_BACKGROUND, Task, printed

MAIN, BACKGROUND = 'main', 'bgmain'
_TYPES = {
    TaskType.NORMAL: 'Normal',
    TaskType.NO_PAUSE: 'NoPause',
    TaskType.NO_EMG_ABORT: 'NoEmgAbort',
    TaskType.TRAP: 'Trap',
    TaskType.BACKGROUND: 'background',
}
_STATES = {
    TaskState.NOT_RUNNING: 'does not run',
    TaskState.RUNNING: 'runs',
    TaskState.WAITING: 'waits',
    TaskState.HALTED: 'paused',
    TaskState.QUICK_PAUSED: 'paused',
    TaskState.ABORTED: 'aborted',
}
STANDSTILL_POLL_S = 0.004
"""Polling period for standstill after a command that moved the arm, s."""

_TRAP_EVENTS = {Tasks.PAUSED: 'pause', Tasks.INTERRUPTED: 'sgopen', Tasks.WAIT_RECOVER: 'sgclose'}
"""State of the paused tasks → name of the Trap event."""

MOTION_ERRORS = range(4000, 6000)
"""Error numbers for which `Trap Error` gets the robot number 1 (SPEL+ manual p856)."""

ROUNDING_S = 1e-9
"""Maximum rounding error of the interpreter's time, which is the clock's since the boot, s."""

_log = logging.getLogger(__name__)


def _nothing() -> None:
    pass


class SpelProgram:
    """A SPEL+ program, which moves the arm and serves the ports that it opens.

    The function main is started at boot and by an operator, BgMain at boot. An operator's start
    clears the global variables unless the program has a BgMain, which may share them.

    * `terminal`: terminal of the program (None: the output is logged).
    * `acquire_arm`: called before a motion to get control of the arm. May raise SpelError.
    * `starts`: function to start instead of main. If it is not main, BgMain is not started.

    Raises ProgramError if the program has statements that are not simulated.
    """

    def __init__(
        self,
        program: Program,
        controller: Controller,
        arm: PointToPoint,
        network: ProgramNetwork,
        terminal: Terminal | None = None,
        acquire_arm: Callable[[], None] = _nothing,
        environment: ProgramEnvironment | None = None,
        starts: str = MAIN,
    ) -> None:
        self._program = program
        self._starts = starts.lower()
        self._background = program.by_name.get(BACKGROUND) if self._starts == MAIN else None
        self.failure: TaskError | None = None
        """The first error that ended a task since the program was started, or None."""
        self._controller = controller
        self._arm = arm
        self._network = network
        self._environment = environment
        self._timing = Timing()
        self._motion = RobotMotion(
            arm, controller.clock, self._soon, self._timing.scan, acquire_arm
        )
        robot = RobotContext(controller, self._motion, RobotPoints(controller.model))
        self._host = SpelHost(
            controller,
            robot,
            network,
            terminal or LogTerminal(controller.clock),
            self._soon,
            self._task_failed,
            self._request_pause,
            self._task_moves,
            lambda: self._machine.running_number == COMMAND_TASK,
        )
        self._timer: Timer | None = None
        self._running = False
        self._later: list[Callable[[], None]] = []
        self._starting = True  # main must be started
        self._finishing = False
        self._ended = False  # whether the tasks have ended, until a person starts the program
        self._mover: Task | None = None  # the task whose motion is executing
        self._answer: Answer | None = None  # gets the result of the current command
        self._output: list[str] = []  # of the current command
        self._command_error: SpelError | None = None
        self._command_moved = False
        self._standstill_timer: Timer | None = None
        network.news = self._soon
        self._machine, self._start_time = self._new_machine()

    def _new_machine(self) -> tuple[Machine, float]:
        machine = Machine(self._program, self._host, self._timing, around=self._environment)
        if self._background is not None:
            machine.start_background(self._background.name)
        self._soon()
        return machine, self._controller.clock.now

    # Time

    def _soon(self) -> None:
        """Run the tasks as soon as the controller's current call is over."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._controller.clock.after(0.0, self._run)

    def _run(self) -> None:
        """Execute the tasks up to the current time, then the actions that they have caused."""
        self._timer = None
        now = self._pass_time()
        self._start_main()
        self._running = True
        try:
            # A command must start now, even if the tasks' time is some microseconds ahead.
            self._machine.advance(max(now, self._machine.time) if self.executes else now)
        finally:
            self._running = False
        while self._later:
            self._later.pop(0)()
        self._check_tasks()
        due = self._machine.next_time()
        if self._timer is None and due is not None:
            self._timer = self._controller.clock.after(max(due - now, 0.0), self._run)

    def _now(self) -> float:
        """Return the time since the boot, s.

        If the next event of a task is due within ROUNDING_S, return the time of that event.
        """
        now = self._controller.clock.now - self._start_time
        due = self._machine.next_time()
        return due if due is not None and now < due < now + ROUNDING_S else now

    def _pass_time(self) -> float:
        """Advance the interpreter's clock to now without executing a task. Return its time, s.

        This is necessary before a task is started or resumed, because its delays count from now.
        """
        now = self._now()
        self._machine.idle(now)
        return now

    def _after_tasks(self, action: Callable[[], None]) -> None:
        """Call `action` now, or at the end of `_run` if this is executing."""
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
            self._machine.start(main.name, clear=self._background is None)
        except SpelError as error:
            _log.error('main is not started: %s', error)
            self._controller.raise_error(error.number)

    def _check_tasks(self) -> None:
        """Abort a motion whose task has ended, answer a command, and detect the program's end."""
        mover = self._mover
        if self._motion.busy and (mover is None or mover.frame is None):
            self._motion.abort(_aborted('its task has ended'))
        self._check_command()
        condition = self._controller.condition
        own = self._controller.program is self
        if own and not self.runs and condition.tasks is Tasks.RUNNING:
            if self._machine.last_event('finish'):
                self._soon()
                return
            self._finishing = True
            self._controller.apply(Event.TASKS_FINISHED)
            self._finishing = False

    def _task_moves(self) -> None:
        self._mover = self._machine.running
        self._command_moved = self._machine.running_number == COMMAND_TASK

    def _alive(self) -> Iterator[TaskView]:
        return (
            task
            for task in self._machine.tasks()
            if task.state is not TaskState.ABORTED and task.number != COMMAND_TASK
        )

    # The command window

    @property
    def executes(self) -> bool:
        """Whether a command is executing."""
        return self._answer is not None

    def execute(self, text: str, answer: Answer) -> None:
        """Start a command, see `CommandWindow.execute`."""
        if self.executes:
            raise RuntimeError('a command is being executed')
        self._pass_time()
        self._output = self._machine.execute(text)
        self._answer, self._command_error, self._command_moved = answer, None, False
        if self._timer is not None:
            self._timer.cancel()
        self._run()

    def abort_command(self, why: str) -> None:
        """Brake and end the current command, if any."""
        task = self._machine.world.tasks.get(COMMAND_TASK)
        if task is None:
            return
        self._command_error = SpelError(ErrorNumber.MOTION_ABORTED, why)
        self._machine.world.end(task)
        self._soon()

    def _check_command(self) -> None:
        """Answer a command that has ended, once the arm is at rest if the command moved it."""
        answer = self._answer
        if answer is None or COMMAND_TASK in self._machine.world.tasks:
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
        """Whether any task except background tasks runs."""
        return self._starting or any(
            task.type is not TaskType.BACKGROUND for task in self._alive()
        )

    @property
    def ready(self) -> bool:
        """Always True, because the program's statements decide which points to accept."""
        return True

    @property
    def main_runs(self) -> bool:
        """Whether main, task 1, is running or about to start."""
        return self._starting or 1 in self._machine.world.tasks

    @property
    def machine(self) -> Machine:
        """The interpreter of the tasks. Each boot creates a new one."""
        return self._machine

    @property
    def statements(self) -> int:
        """Number of statements executed since the controller was booted."""
        return self._machine.statements

    def receive(self, frame: Frame) -> None:
        """Raise RuntimeError, because the program's own ports receive the bytes."""
        raise RuntimeError(f'a SPEL+ program accepts no frame ({frame.msg_type})')

    def step(self, dt: float) -> None:
        """Advance the arm by `dt` ≥ 0 s."""
        time_left = self._arm.step(dt)
        while time_left is not None and time_left > 0.0 and self._arm.moving:
            time_left = self._arm.step(time_left)
        self._motion.update()

    def abort(self) -> None:
        """Brake after the motors went off. The task that moves the arm gets error 2999."""
        self._motion.abort(_aborted('the motors went off'))
        self._soon()

    def restart(self) -> None:
        """Brake, and end the tasks that an E-stop, an error or a stop ends."""
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
                    self._machine.event('emergency')
                else:
                    self._machine.event('error', number, int(number in MOTION_ERRORS))
                self._machine.emergency_stop()
            else:
                self._machine.stop()
                self._machine.last_event('abort')

        self._after_tasks(end)

    def detach(self) -> None:
        """Do nothing, because the program's statements detect the loss of a client."""

    def boot(self) -> None:
        """Restart the program. Only preserved variables keep their values."""
        self.abort_command('the command was aborted: the controller was switched off')
        self._after_tasks(self._boot)

    def _boot(self) -> None:
        preserved_values = self._machine.preserved()
        self._motion.abort(_aborted('the controller was switched off'))
        self._network.close_all()
        self._machine, self._start_time = self._new_machine()
        self._machine.restore(preserved_values)
        self._starting, self._ended = True, False
        self._soon()

    def pause(self) -> None:
        """Pause the Normal tasks, and start the Trap task for a pause or the door, if any."""
        event = _TRAP_EVENTS.get(self._controller.condition.tasks)

        def pause_tasks() -> None:
            self._machine.pause()
            if event is not None:
                self._machine.event(event)

        self._after_tasks(pause_tasks)

    def resume(self) -> None:
        """Resume after a pause, or start main if the tasks had ended."""
        tasks = self._controller.condition.tasks
        if tasks in ENDED:
            if tasks is Tasks.STOPPED:  # possibly by a reset
                self._after_tasks(self._machine.clear_errors)
            return
        if self._ended:
            self._ended = False
            self._starting = not self._running  # not if StartMain is starting it
        self._motion.update()
        self._after_tasks(self._machine.resume)

    def tasks(self) -> Iterator[TaskRow]:
        """Yield the tasks. The state of each includes its file and line."""
        for task in self._machine.tasks():
            state = f'{_STATES[task.state]} {_plain(task.file)}:{task.line}'
            yield TaskRow(task.number, task.function, _TYPES[task.type], state)

    # Effects of its tasks on the controller

    def _task_failed(self, error: TaskError) -> None:
        """Raise an error of the controller, a critical one if a background task failed.

        The error of a command is only returned in its answer.
        """
        if error.task == COMMAND_TASK:
            self._command_error = SpelError(error.number, error.text)
            return
        critical = FIRST_BACKGROUND <= error.task <= LAST_BACKGROUND
        _log.error('%s', error)
        self.failure = self.failure or error
        report = error.details
        self._later.append(lambda: self._controller.raise_error(error.number, critical, report))
        self._soon()

    def _request_pause(self, on: bool) -> None:
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
