# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The scheduler of a controller's tasks, on a clock that the host advances.

One processor is simulated. A task runs for 1 ms of the controller's time (`Timing.turn`), then the
next task that can run. Each statement takes a fixed time on this clock, so a run gives the same
result on every computer.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import lru_cache
from types import CodeType
from typing import Any, NamedTuple

from epson_driver.spel import frames, library, values
from epson_driver.spel.actions import STATEMENTS, set_point
from epson_driver.spel.builtins import TASK_FUNCTIONS
from epson_driver.spel.code import FunctionCode, Program
from epson_driver.spel.commands import TRAP_EVENTS, TaskType
from epson_driver.spel.errors import ErrorNumber, SpelError
from epson_driver.spel.file_access import FILE_FUNCTIONS, FILE_STATEMENTS
from epson_driver.spel.files import ProgramEnvironment
from epson_driver.spel.host import Host
from epson_driver.spel.library import VALUE_FUNCTIONS, power, remainder
from epson_driver.spel.point_actions import POINT_FUNCTIONS, POINT_STATEMENTS
from epson_driver.spel.ports import NET_STATEMENTS
from epson_driver.spel.project import command
from epson_driver.spel.ranges import refuse
from epson_driver.spel.task import (
    COMMAND_TASK,
    FIRST_BACKGROUND,
    FIRST_HELPER,
    FIRST_TRAP,
    Frame,
    Instruction,
    Linked,
    SharedState,
    Task,
    TaskState,
    Timing,
    blank,
)
from epson_driver.spel.values import (
    Array,
    Value,
    finite,
    nearest,
    overflow,
    single,
    store,
    too_long,
)

_SOURCE = '<spel>'


@lru_cache(maxsize=16)
def _code_of(source: str) -> CodeType:
    """Compile a portion of a program's Python text. All machines that run it share the result."""
    return compile(source, _SOURCE, 'exec')


_PROGRAM = (_SOURCE, library.__file__, values.__file__, frames.__file__)
_ARITHMETIC: dict[type[Exception], ErrorNumber] = {
    ZeroDivisionError: ErrorNumber.DIVISION_BY_ZERO,
    OverflowError: ErrorNumber.OVERFLOW,
    IndexError: ErrorNumber.INDEX,
    ValueError: ErrorNumber.ARGUMENT,
}
"""Exception of Python's arithmetic → error number in the program."""


def all_statements() -> dict[str, Callable[..., None]]:
    tables = (STATEMENTS, NET_STATEMENTS, POINT_STATEMENTS, FILE_STATEMENTS)
    return {name: run for table in tables for name, run in table.items()}


class TaskView(NamedTuple):
    number: int
    function: str
    type: TaskType
    state: TaskState
    file: str
    line: int


KEPT_COMMANDS = 64
"""Maximum number of compiled commands in the cache. Clients of `$Execute` often repeat a
command."""


class Machine:
    """Runs a program on a host.

    The time starts at 0 and passes only in `advance`. The host calls `advance` at the time
    `next_time()`, and immediately after an event for which a task may be waiting.
    """

    def __init__(
        self,
        program: Program,
        host: Host,
        timing: Timing | None = None,
        around: ProgramEnvironment | None = None,
    ) -> None:
        around = around or ProgramEnvironment()
        self.world = SharedState(program, host, timing or Timing(), around)
        self._turn = max(int(self.world.timing.turn / self.world.timing.statement), 1)
        self._last = 0
        self._next_scan = 0.0
        self.statements = 0
        """Number of executed statements. Each iteration of a For counts twice."""
        self._command = lru_cache(KEPT_COMMANDS)(self._compiled)
        self._link()

    def _link(self) -> None:
        """Run the program's Python text, which defines the instructions of this machine."""

        def over(type_name: str, value: int) -> Value:
            raise overflow(type_name, value)

        def index(value: int) -> int:
            raise SpelError(ErrorNumber.INDEX, f'index {value} is below 0')

        def long(text: str) -> str:
            raise too_long(text)

        def unlabelled(name: str) -> int:
            text = f'the I/O label {name} has no number: add it to IOLabels.dat, or #define {name}'
            raise SpelError(ErrorNumber.ARGUMENT, text)

        names: dict[str, Any] = {
            'g': self.world.g,
            'F': self.world.linked,
            'WHOLE': nearest,
            'OVER': over,
            'INDEX': index,
            'LONG': long,
            'UNLABELLED': unlabelled,
            'SINGLE': single,
            'FINITE': finite,
            'MOD': remainder,
            'POWER': power,
            'REFUSE': refuse,
            'store': store,
            'set_point': set_point,
            'CHANGED': frames.changed,
            'ADDED': frames.added,
        }
        self._names = names
        in_task = {**TASK_FUNCTIONS, **POINT_FUNCTIONS, **FILE_FUNCTIONS}
        for table, letter in ((VALUE_FUNCTIONS, 'f'), (in_task, 't')):
            for name, function in table.items():
                names[f'{letter}_{name.replace("$", "_s")}'] = function
        for name, statement in all_statements().items():
            names[f's_{name}'] = statement
        program = self.world.program
        for portion in program.source:
            exec(_code_of(portion), names)  # noqa: S102 - compiler.py wrote it
        self.world.linked += [self._linked(code) for code in program.functions]

    def _linked(self, code: FunctionCode) -> Linked:
        result: list[Instruction] = [
            self._names[f'o{code.index}_{number}'] for number in range(len(code.source))
        ]
        return Linked(code, result, bytearray(len(result)))

    # Actions of users and the controller

    def start(
        self,
        name: str = 'main',
        number: int = 1,
        kind: TaskType = TaskType.NORMAL,
        clear: bool = True,
    ) -> None:
        """Start a function without parameters as a task. `clear` also clears global variables.

        Raises SpelError if the function does not exist, or if a task with this number is running.
        """
        self.world.add(number, self.world.function(name), (), kind)
        if clear:
            self.clear_variables()

    def start_background(self, name: str = 'BgMain') -> None:
        self.start(name, FIRST_BACKGROUND, TaskType.BACKGROUND, clear=False)

    def execute(self, text: str) -> list[str]:
        """Start a command of the command window as task 0.

        Return the list to which its output will be added. Raises ProgramError if the command is
        invalid, SpelError if another command is running.
        """
        task = self.world.add(COMMAND_TASK, self._command(text), (), TaskType.NORMAL)
        task.output = []
        return task.output

    def _compiled(self, text: str) -> Linked:
        code = command(self.world.program, text, self.world.stubs.words)
        source = ''.join(code.source)
        exec(compile(source, _SOURCE, 'exec'), self._names)  # noqa: S102 - compiler.py wrote it
        return self._linked(code)

    def clear_variables(self) -> None:
        for slot, variable in enumerate(self.world.program.variables):
            if not variable.preserved:
                self.world.g[slot] = blank(variable)

    def preserved(self) -> dict[str, list[Value]]:
        result: dict[str, list[Value]] = {}
        for slot, variable in enumerate(self.world.program.variables):
            if variable.preserved:
                value = self.world.g[slot]
                result[variable.name] = (
                    list(value.d) if isinstance(value, Array) else [value]  # type: ignore[list-item]
                )
        return result

    def restore(self, values: dict[str, list[Value]]) -> None:
        """Set the values that `preserved` returned.

        Arrays whose size has changed in the meantime are not set.
        """
        for slot, variable in enumerate(self.world.program.variables):
            stored = values.get(variable.name)
            current = self.world.g[slot]
            if not variable.preserved or stored is None:
                continue
            if isinstance(current, Array):
                if len(stored) == len(current.d):
                    current.d[:] = [store(value, variable.type) for value in stored]
            elif len(stored) == 1:
                self.world.g[slot] = store(stored[0], variable.type)

    def emergency_stop(self) -> None:
        """End all Normal, NoPause and Trap tasks, as an E-stop or an error does."""
        self._end(TaskType.NORMAL, TaskType.NO_PAUSE, TaskType.TRAP)

    def stop(self) -> None:
        self._end(TaskType.NORMAL, TaskType.NO_PAUSE, TaskType.NO_EMG_ABORT, TaskType.TRAP)

    def _end(self, *kinds: TaskType) -> None:
        for task in list(self.world.tasks.values()):
            if task.type in kinds:
                self.world.end(task)

    def pause(self) -> None:
        for task in self.world.tasks.values():
            task.paused = task.type is TaskType.NORMAL

    def resume(self) -> None:
        """Resume the paused tasks. Timed waits start again from their beginning."""
        for task in self.world.tasks.values():
            if task.paused:
                task.paused = False
                self._start_wait(task)

    def clear_errors(self) -> None:
        self.world.aborted.clear()

    def event(self, name: str, *numbers: int) -> bool:
        """Start the Trap for an event, such as 'emergency', 'error' or 'sgopen'.

        Return whether a Trap was started.
        """
        linked = self.world.event_traps.get(name)
        if linked is None:
            return False
        number = FIRST_TRAP + 4 + list(TRAP_EVENTS).index(name)
        if number in self.world.tasks:
            return False
        arguments = (*numbers, 0, 0, 0)[: len(linked.code.parameters)]
        self.world.add(number, linked, arguments, TRAP_EVENTS[name])
        return True

    def last_event(self, name: str) -> bool:
        """Start the Trap for 'abort' or 'finish'. Remove all event Traps (SPEL+ manual p855)."""
        started = self.event(name)
        self.world.event_traps.clear()
        return started

    # Queries

    @property
    def time(self) -> float:
        return self.world.time

    @property
    def running(self) -> Task | None:
        """Return the task that ran last, or None if this task has ended."""
        return self.world.tasks.get(self._last)

    @property
    def running_number(self) -> int:
        return self._last

    def tasks(self) -> Iterator[TaskView]:
        """Yield the existing tasks, and the tasks that ended with an error, sorted by number."""
        aborted = self.world.aborted
        for number in sorted({*self.world.tasks, *aborted}):
            if number >= FIRST_HELPER:
                return
            task = self.world.tasks.get(number)
            if task is None:
                error = aborted[number]
                at = error.position
                kind = TaskType.NORMAL
                yield TaskView(number, error.function, kind, TaskState.ABORTED, at.file, at.line)
            elif task.frame is not None:
                at = task.frame.linked.code.lines[task.frame.pc]
                yield TaskView(number, task.function, task.type, task.state, at.file, at.line)

    def lines(self) -> dict[str, dict[int, bool]]:
        """Return for each file and line whether all of its instructions have been executed."""
        result: dict[str, dict[int, bool]] = {}
        for linked in self.world.linked:
            for pc, at in enumerate(linked.code.lines):
                if pc in linked.code.passed_over:
                    continue
                executed = result.setdefault(at.file, {})
                executed[at.line] = executed.get(at.line, True) and bool(linked.hits[pc])
        return result

    # Time

    def next_time(self) -> float | None:
        """Return the time of the next event, or None if all tasks wait for the host."""
        if self._ready() is not None:
            return self.world.time
        return self._next_due()

    def idle(self, to: float) -> None:
        """Advance the time without running tasks, to `to`, s, or to an earlier event.

        A host calls it before `advance` when an event occurs at `to`. A task that waits for the
        event then resumes at that time, not at the time of the previous call.
        """
        if self._ready() is None:
            due = self._next_due()
            self.world.time = max(self.world.time, to if due is None else min(to, due))

    def advance(self, to: float) -> None:
        """Run the tasks until the time `to`, s. The last statement may end after this time.

        Waiting tasks are checked even if the clock is already past `to`. A task that waited for an
        event of the host then runs at `next_time()`.
        """
        world = self.world
        while True:
            self._wake()  # also after each task, which may have met the condition of another
            if world.time > to:
                return
            task = self._ready()
            if task is not None:
                self._last = task.number
                used = self._run(task)
                world.time += used * world.timing.statement
                self._start_wait(task)
                continue
            due = self._next_due()
            if due is None or due > to:
                world.time = to
                return
            world.time = max(world.time, due)

    def _ready(self) -> Task | None:
        """Return the task that runs next, or None if all tasks wait.

        Tasks take turns in the order of their numbers.
        """
        tasks = self.world.tasks
        ready = [number for number, task in tasks.items() if _can_run(task)]
        if not ready:
            return None
        after = [number for number in ready if number > self._last]
        return tasks[min(after or ready)]

    def _next_due(self) -> float | None:
        times = []
        for task in self.world.tasks.values():
            waiting = task.waiting
            if waiting is None or not _awake(task):
                continue
            if waiting.until is not None:
                times.append(waiting.until)
            if waiting.scanned:
                times.append(waiting.next_scan)
        if self.world.traps:
            times.append(self._next_scan)
        times += [due for due, _ in self.world.later]
        return min(times, default=None)

    def _wake(self) -> None:
        time = self.world.time
        for due, action in [item for item in self.world.later if item[0] <= time]:
            self.world.later.remove((due, action))
            with suppress(SpelError):  # it may be refused by now, without a task to report it to
                action()
        for number in sorted(self.world.tasks):
            task = self.world.tasks.get(number)
            if task is None or task.waiting is None or not _awake(task):
                continue
            waiting = task.waiting
            try:
                holds = False
                if waiting.test is not None and (not waiting.scanned or time >= waiting.next_scan):
                    holds = bool(waiting.test())
                    while waiting.scanned and waiting.next_scan <= time:
                        waiting.next_scan += self.world.timing.scan
            except SpelError as error:
                task.fail(error)
                continue
            if holds:
                task.wake(False)
            elif waiting.until is not None and time >= waiting.until:
                task.wake(True)
        if self.world.traps and time >= self._next_scan:
            self._next_scan = time + self.world.timing.scan
            self._spring()

    def _spring(self) -> None:
        """Start the action of each Trap whose condition is met, and disarm this Trap."""
        for number, trap in list(self.world.traps.items()):
            if trap.task.frame is None:
                del self.world.traps[number]
                continue
            try:
                holds = trap.test()
            except SpelError as error:
                del self.world.traps[number]
                trap.task.fail(error)
                continue
            if holds:
                del self.world.traps[number]
                if isinstance(trap.target, int):
                    if trap.frame in trap.task.frames:
                        trap.task.go_to(trap.frame, trap.target)
                    continue
                if FIRST_TRAP + number - 1 in self.world.tasks:
                    continue
                started = self.world.add(FIRST_TRAP + number - 1, trap.target, (), TaskType.TRAP)
                if trap.action == 'call':
                    trap.task.discontinue()
                    trap.task.interrupted_by = started

    def _start_wait(self, task: Task) -> None:
        """Start the timer of a task's wait. Its statement or a pause has just ended."""
        waiting = task.waiting
        if waiting is not None and waiting.until is not None and waiting.duration is not None:
            waiting.until = self.world.time + waiting.duration

    def _run(self, task: Task) -> int:
        """Run a task for `Timing.turn`, or until it waits or ends.

        Return the number of instructions.
        """
        limit, used = self._turn, 0
        frame = task.frame
        while frame is not None and used < limit and task.waiting is None:
            used += self._run_frame(task, frame, limit - used)
            frame = task.frame
            if task.suspended:
                break
        self.statements += used
        task.since_wait += used
        if task.since_wait > self.world.timing.endless and task.frame is not None:
            task.since_wait = 0
            task.fail(SpelError(ErrorNumber.ENDLESS_LOOP))
        return used

    def _run_frame(self, task: Task, frame: Frame, limit: int) -> int:
        instructions, hits, v, pc = frame.linked.instructions, frame.linked.hits, frame.v, frame.pc
        used = 0
        try:
            while used < limit:
                used += 1
                hits[pc] = 1
                frame.pc = pc
                following = instructions[pc](v)
                if following < 0:
                    if task.frame is not frame or task.waiting is not None:
                        return used
                    pc = frame.linked.code.following[pc]
                    frame.pc = pc
                    if task.suspended:
                        return used
                    continue
                pc = following
            frame.pc = pc
        except SpelError as error:
            task.fail(error)
        except tuple(_ARITHMETIC) as error:
            if not _of_program(error):  # a fault of the host must not look like the program's
                raise
            number = next(_ARITHMETIC[kind] for kind in _ARITHMETIC if isinstance(error, kind))
            text = f'{error}' if number is ErrorNumber.ARGUMENT else ''
            task.fail(SpelError(number, text))
        return used


def _of_program(error: Exception) -> bool:
    """Return whether the program caused an exception.

    This is so if generated code, library.py, values.py or frames.py raised the exception.
    """
    trace = error.__traceback__
    assert trace is not None  # noqa: S101 - it was raised
    while trace.tb_next is not None:
        trace = trace.tb_next
    return trace.tb_frame.f_code.co_filename in _PROGRAM


def _awake(task: Task) -> bool:
    if task.interrupted_by is not None and task.interrupted_by.frame is None:
        task.interrupted_by = None
    return not task.suspended


def _can_run(task: Task) -> bool:
    return task.waiting is None and _awake(task)
