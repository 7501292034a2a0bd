# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Tasks: their calls, waits and errors, and their shared state."""

import random
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from epson_driver.spel.code import FunctionCode, Program, Variable
from epson_driver.spel.commands import COMMANDS, TaskType, forbidden
from epson_driver.spel.errors import ErrorNumber, SpelError, TaskError, meaning
from epson_driver.spel.files import ProgramEnvironment, Stubs
from epson_driver.spel.frames import Pallet, in_local, in_world, turned_step
from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.host import Caller, Completion, Host, Memory, MotionRequest, NetSettings
from epson_driver.spel.values import (
    INT,
    POINT,
    STRING,
    TYPES,
    Array,
    Point,
    Value,
    nearest,
    store,
)

DEEPEST_CALL = 100

LAST_NORMAL, FIRST_BACKGROUND, LAST_BACKGROUND, FIRST_TRAP = 32, 65, 80, 257
"""Ranges of task numbers. Normal tasks have the numbers 1 to LAST_NORMAL, background tasks
FIRST_BACKGROUND to LAST_BACKGROUND, and trap tasks FIRST_TRAP and above.
"""
FIRST_HELPER = 1000
"""Number that is added to a task's number to get the number of its parallel statements (`!…!`). A
separate task executes parallel statements, next to the task that moves the arm."""
COMMAND_TASK = 0
"""Task number of the command window, which no program can use."""

Instruction = Callable[[list[object]], int]
Test = Callable[[], object]
Reference = tuple[list[Value], int, str]
"""A reference to a variable: the list that contains it, its index there, and its type."""

GATE = 7
"""Number of the arch without rounded corners (SPEL+ manual p111)."""


class TaskState(IntEnum):
    NOT_RUNNING = 0
    RUNNING = 1
    WAITING = 2
    HALTED = 3
    QUICK_PAUSED = 4
    ABORTED = 5


@dataclass(frozen=True, slots=True)
class Timing:
    """Times on the controller, in s.

    * statement: duration of a simple statement.
    * granularity: unit to which Wait rounds up.
    * scan: period of condition checks.
    * turn: maximum time for which a task runs before the next task runs.
    * endless: number of statements without a wait after which error 2556 is raised.
    """

    statement: float = 10e-6
    granularity: float = 0.010
    scan: float = 0.010
    turn: float = 0.001
    endless: int = 1_000_000


@dataclass(slots=True)
class Linked:
    """A compiled function with its executable instructions.

    `hits` is 1 for each instruction that has been executed.
    """

    code: FunctionCode
    instructions: list[Instruction]
    hits: bytearray


class Frame:
    __slots__ = ('error_pc', 'gosubs', 'handler', 'handling', 'into', 'linked', 'pc', 'v')

    def __init__(self, task: 'Task', linked: Linked, arguments: Sequence[object], into: int):
        code = linked.code
        self.linked = linked
        self.pc = 0
        self.handler = -1
        self.handling = False
        self.error_pc = 0
        self.gosubs: list[int] = []
        self.into = into
        self.v: list[object] = [task, *arguments, *code.blanks]
        for variable in code.arrays:
            self.v[variable.slot] = Array(variable.type, variable.bounds)


@dataclass(slots=True)
class Waiting:
    """The condition of a waiting task: a time, a test, or both.

    * until, duration: end time of the wait, and its length, s, or None without a time limit.
    * scanned: whether the test is evaluated only every `Timing.scan` s, as on the controller,
      instead of each time a task has run.
    * after: called at the end of the wait, with True after a timeout.
    """

    until: float | None
    duration: float | None
    test: Test | None
    scanned: bool
    next_scan: float
    after: Callable[[bool], None] | None


@dataclass(slots=True)
class Port:
    """A network port: its settings, and the number of the task that opened it (0: not open)."""

    settings: NetSettings = field(default_factory=lambda: NetSettings('', 0))
    owner: int = 0


@dataclass(slots=True)
class OpenFile:
    name: str
    data: bytearray
    at: int
    reads: bool


@dataclass(slots=True)
class Trap:
    """An armed Trap 1 to 4.

    `target`: the function to run or, for GoTo, an instruction in `frame`.
    """

    task: 'Task'
    test: Test
    target: Linked | int
    action: str
    frame: Frame | None


class SharedState:
    def __init__(
        self,
        program: Program,
        host: Host,
        timing: Timing,
        around: ProgramEnvironment,
    ) -> None:
        self.program = program
        self.host = host
        self.timing = timing
        self.time = 0.0
        self.linked: list[Linked] = []
        self.g: list[object] = [blank(variable) for variable in program.variables]
        self.tasks: dict[int, Task] = {}
        self.mover: Task | None = None
        self.aborted: dict[int, TaskError] = {}
        self.ports = {number: Port(item) for number, item in around.ports.items()}
        self.stubs = Stubs(around.answers)
        self.files = around.files
        self.open_files: dict[int, OpenFile] = {}
        self.locks: dict[int, int] = {}
        self.signals: dict[int, int] = {}
        self.points: dict[int, Point] = {}
        self.load(program.data.points)
        self.point_labels = dict(program.data.point_labels)
        self.spelling = dict(program.data.spelling)
        self.locals: dict[int, Point] = {}
        self.arches = {number: (30.0 + 10.0 * number,) * 2 for number in range(7)}
        """Number of an arch → depart and approach distance, mm (SPEL+ manual p111)."""
        self.pallets: dict[int, Pallet] = {}
        self.conditions: dict[str, Test] = {}
        self.timers: dict[int, float] = {}
        self.elapsed_from = 0.0
        self.traps: dict[int, Trap] = {}
        self.event_traps: dict[str, Linked] = {}
        self.later: list[tuple[float, Callable[[], None]]] = []
        """Actions that are scheduled for a time. They do not depend on a task."""
        self.random = random.Random(0)  # noqa: S311 - for Rnd, the same in every run

    def function(self, name: str) -> Linked:
        code = self.program.by_name.get(name.lower())
        if code is None:
            raise SpelError(ErrorNumber.NO_SUCH_TASK, f'there is no function {name}')
        return self.linked[code.index]

    def free_number(self, background: bool) -> int:
        first, last = (FIRST_BACKGROUND, LAST_BACKGROUND) if background else (1, LAST_NORMAL)
        for number in range(first, last + 1):
            if number not in self.tasks:
                return number
        raise SpelError(ErrorNumber.TASK_NUMBER, f'all tasks from {first} to {last} are in use')

    def add(
        self, number: int, linked: Linked, arguments: Sequence[object], kind: TaskType
    ) -> 'Task':
        if number in self.tasks:
            raise SpelError(ErrorNumber.TASK_NUMBER, f'task {number} is running')
        code = linked.code
        if len(arguments) != len(code.parameters):
            text = f'{code.name} has {len(code.parameters)} parameters'
            raise SpelError(ErrorNumber.ARGUMENT, text)
        task = Task(self, number, kind)
        self.aborted.pop(number, None)
        task.push(linked, arguments, 0)
        self.tasks[number] = task
        return task

    def add_helper(self, task: 'Task', start: int, motion: Completion) -> 'Task':
        """Start the task for the parallel statements of a motion.

        The new task uses the variables of the function that contains the parallel statements.
        """
        helper = Task(self, FIRST_HELPER + task.number, task.type)
        moving = task.current
        helper.push(moving.linked, moving.v[1 : 1 + len(moving.linked.code.parameters)], 0)
        helper.current.v[1:] = moving.v[1:]
        helper.current.pc = start
        helper.motion, helper.output = motion, task.output
        self.tasks[helper.number] = helper
        return helper

    def end(self, task: 'Task') -> None:
        """End a task.

        The task's locks are released. Its ports stay open, but belong to no task.
        """
        helper = self.tasks.get(FIRST_HELPER + task.number)
        if helper is not None:
            self.end(helper)
        task.frames.clear()
        task.frame = None
        task.waiting = None
        if self.tasks.get(task.number) is task:
            del self.tasks[task.number]
            for number, port in self.ports.items():
                if port.owner == task.number:
                    self.host.network.release_owner(number)
        for number in [item for item, owner in self.locks.items() if owner == task.number]:
            del self.locks[number]

    def task(self, which: int | str) -> 'Task | None':
        if isinstance(which, str):
            named = (item for item in self.tasks.values() if item.function.lower() == which)
            return next(named, None)
        return self.tasks.get(which)

    def load(self, points: Mapping[int, Point]) -> None:
        """Load the points of a file into memory, in the form in which the robot stores points."""
        self.points |= {number: self.host.stored_point(item) for number, item in points.items()}

    def placed(self, arguments: Sequence[Any], steps: bool = False) -> tuple[Any, ...]:
        """Convert the points in `arguments` to Local 0. Raises SpelError if a local is undefined.

        `steps`: whether the points are steps from the current position.
        """
        into = turned_step if steps else in_world
        return tuple(
            into(argument, self.locals) if isinstance(argument, Point) else argument
            for argument in arguments
        )

    def error_text(self, number: int) -> str:
        return self.program.data.texts.get(number) or meaning(number)


def printed(output: list[str]) -> str:
    """Return the output of a command with CRLF between its lines."""
    return ''.join(output).removesuffix('\n').replace('\n', '\r\n')


def blank(variable: Variable) -> object:
    if variable.bounds:
        return Array(variable.type, variable.bounds)
    return TYPES[variable.type].blank


class Task:
    """A task: its calls and its wait. The compiled instructions call its methods."""

    def __init__(self, world: SharedState, number: int, kind: TaskType) -> None:
        self.world = world
        self.number = number
        self.type = kind
        self.frames: list[Frame] = []
        self.frame: Frame | None = None
        self.waiting: Waiting | None = None
        self.halted = False
        self.paused = False
        self.interrupted_by: Task | None = None
        self.function = ''
        self.timed_out = False
        self.default_timeout: float | None = None
        self.error: TaskError | None = None
        self.since_wait = 0
        self.motion: Completion | None = None
        """The motion that owns this parallel (`!…!`) task."""
        self.output: list[str] | None = None
        """Output of a command, which is collected here instead of being displayed."""

    # Calls

    def push(self, linked: Linked, arguments: Sequence[object], into: int) -> None:
        """Enter a function. `into`: slot for its return value.

        Raises SpelError if more than DEEPEST_CALL calls are nested.
        """
        if len(self.frames) >= DEEPEST_CALL:
            raise SpelError(ErrorNumber.CALL_DEPTH, f'more than {DEEPEST_CALL} nested calls')
        if not self.frames:
            self.function = linked.code.name
        self.frame = Frame(self, linked, arguments, into)
        self.frames.append(self.frame)

    call = push

    def leave(self) -> None:
        """Leave a function and pass its value to the caller. Without a caller, end the task."""
        left = self.frames.pop()
        if not self.frames:
            self.world.end(self)
            return
        self.frame = self.frames[-1]
        self.frame.v[left.into] = left.v[left.linked.code.result_slot]
        self.frame.pc = self.frame.linked.code.following[self.frame.pc]

    @property
    def current(self) -> Frame:
        assert self.frame is not None  # noqa: S101 - a task that runs has one
        return self.frame

    def gosub(self, back: int) -> None:
        if len(self.current.gosubs) >= DEEPEST_CALL:
            raise SpelError(ErrorNumber.CALL_DEPTH, f'more than {DEEPEST_CALL} nested GoSub')
        self.current.gosubs.append(back)

    def gosub_return(self) -> int:
        if not self.current.gosubs:
            raise SpelError(ErrorNumber.RETURN_WITHOUT_GOSUB)
        return self.current.gosubs.pop()

    # Errors

    def on_error(self, handler: int) -> None:
        """Set the error handler to the instruction `handler`. -1 removes the handler."""
        self.current.handler = handler

    def resumed(self) -> None:
        """Mark the current error as handled. Raises SpelError if no error is being handled."""
        if not self.current.handling:
            raise SpelError(ErrorNumber.RESUME)
        self.current.handling = False

    def resume(self, following: bool) -> int:
        """Return the instruction at which EResume continues.

        EResume continues at the start of the failed statement or, if `following`, of the next one.
        """
        self.resumed()
        frame = self.current
        starts = frame.linked.code.starts
        if not following:
            return starts[frame.error_pc]
        pc = frame.error_pc + 1
        while pc < len(starts) - 1 and starts[pc] == starts[frame.error_pc]:
            pc += 1
        return pc

    def fail(self, error: SpelError) -> None:
        """Pass an error to the error handler of the function or of one of its callers.

        Without an error handler, end the task.
        """
        if self.frame is None:  # the failed statement has ended the task
            return
        frame = self.frame
        self.waiting = None
        place = frame.linked.code.lines[frame.pc]
        name = frame.linked.code.name
        failure = TaskError(error.number, error.text, place, name, self.number)
        self.error = failure
        if self.motion is not None:  # the task that moves the arm gets the error
            self.world.end(self)
            return
        while self.frames:
            frame = self.frames[-1]
            if frame.handler >= 0 and not frame.handling:
                self.frame = frame
                frame.handling = True
                frame.error_pc = frame.pc
                frame.pc = frame.handler
                return
            self.frames.pop()
        self.world.end(self)
        if self.number != COMMAND_TASK:
            self.world.aborted[self.number] = failure
        self.world.host.task_failed(failure)

    # Waiting

    def wait(
        self,
        seconds: float | None,
        test: Test | None = None,
        after: Callable[[bool], None] | None = None,
        scanned: bool = False,
    ) -> None:
        """Wait until `test` holds or `seconds` have passed, then call `after(timed_out)`."""
        self.since_wait = 0
        if test is not None and test():
            if after is not None:
                after(False)
            return
        now = self.world.time
        self.waiting = Waiting(
            None if seconds is None else now + seconds,
            seconds,
            test,
            scanned,
            now + self.world.timing.scan,
            after,
        )

    def wait_or_time_out(
        self,
        seconds: float | None,
        test: Test,
        then: Callable[[bool], None] | None = None,
        scanned: bool = False,
    ) -> None:
        """Wait like `wait`, and store whether the wait timed out as the value of TW.

        Then call `then` with the same boolean.
        """
        self.timed_out = False

        def after(timed_out: bool) -> None:
            self.timed_out = timed_out
            if then is not None:
                then(timed_out)

        self.wait(seconds, test, after, scanned)

    def discontinue(self) -> None:
        """End the current wait and the current motion.

        A Trap that interrupts the task's statement calls this (SPEL+ manual p852).
        """
        helper = self.world.tasks.get(FIRST_HELPER + self.number)
        if helper is not None:
            self.world.end(helper)
        if self.waiting is not None:
            self.waiting = None
            self.current.pc = self.current.linked.code.following[self.current.pc]
        if self.world.mover is self:
            with suppress(SpelError):  # nothing moves
                self.world.host.command('abortmotion', (), ())

    def go_to(self, frame: Frame, target: int) -> None:
        """End the current statement. Continue at the instruction `target` of the call `frame`."""
        self.discontinue()
        while self.frames[-1] is not frame:
            self.frames.pop()
        self.frame, frame.pc = frame, target

    def wake(self, timed_out: bool) -> None:
        """Continue after the waiting statement, or handle the error that its `after` raises."""
        waiting, self.waiting = self.waiting, None
        frame = self.current
        try:
            if waiting is not None and waiting.after is not None:
                waiting.after(timed_out)
        except SpelError as error:
            self.fail(error)
        else:
            frame.pc = frame.linked.code.following[frame.pc]

    def wait_for(self, completion: Completion | None) -> None:
        if completion is None:
            return
        started = completion

        def after(_timed_out: bool) -> None:
            if started.error is not None:
                raise started.error

        self.wait(None, lambda: started.done, after)

    # Requests of instructions to the host

    @property
    def caller(self) -> Caller:
        frame = self.current
        place = frame.linked.code.lines[frame.pc]
        return Caller(self.number, self.function, place.file, place.line)

    def may(self, name: str, words: tuple[str, ...] = ()) -> None:
        rule = COMMANDS[name]
        if forbidden(rule, words, self.type):
            kind = self.type.name.lower().replace('_', ' ')
            raise SpelError(ErrorNumber.TASK_TYPE, f'{rule.name} cannot run in a task {kind}')

    def value(self, name: str, arguments: tuple[int | float | Point, ...]) -> object:
        """Return the host's value of the function `name`.

        Points are passed in Local 0, except to CX to CW.
        """
        self.since_wait = 0  # a loop that reads inputs is not endless
        if name[0] != 'c':
            arguments = self.world.placed(arguments)
        result = self.world.host.value(name, arguments)
        return int(result) if FUNCTIONS[name].result == 'i' else result  # type: ignore[arg-type]

    def labelled(self, label: str) -> int:
        number = self.world.point_labels.get(label.lower())
        if number is None:
            raise SpelError(ErrorNumber.POINT_UNDEFINED, f'there is no point {label}')
        return number

    def flagged(self, point: Point, flag: str) -> Point:
        """Return a point changed by a suffix of SPEL+.

        `/L` sets a posture, and `/1` the local coordinate system, without a change of coordinates.
        `@1` converts the coordinates to local 1.
        """
        if flag[0] == '@':
            return in_local(point, int(flag[1:]), self.world.locals)
        return point.flagged(flag)

    def command(
        self, name: str, arguments: tuple[Value | Point | None, ...], words: tuple[str, ...]
    ) -> None:
        self.may(name, words)
        if arguments and (choices := COMMANDS[name].choices):
            words = (choices[not arguments[0]].lower(), *words)
            arguments = ()
        try:
            completion = self.world.host.command(name, arguments, words)
        except SpelError as error:
            mover = self.world.mover
            if name != 'abortmotion' or mover is None or mover is self or mover.frame is None:
                raise
            mover.fail(error)  # the task that moved the robot before gets it (p65)
            return
        self.wait_for(completion)

    def stored(self, name: str) -> Callable[[], bool]:
        """Return the condition stored by Till, Find or Sense (default: Sw(0), manual p829)."""
        test = self.world.conditions.get(name)
        if test is None:
            host = self.world.host
            return lambda: bool(host.read_bits(Memory.INPUT, 0, 1))
        return lambda: bool(test())

    def move(
        self,
        name: str,
        points: tuple[Point, ...],
        words: tuple[str, ...],
        numbers: dict[str, float],
        beside: int | None,
        **modifiers: Any,
    ) -> None:
        """Start a motion and wait for its end.

        `beside`: first instruction of the motion's parallel statements, if any. `modifiers`: the
        fields cp, till, find and sense of MotionRequest.
        """
        self.may(name)
        for word in {'ecp', 'sync'}.intersection(words):
            text = f'{COMMANDS[name].name} … {word.upper()} is not simulated'
            raise SpelError(ErrorNumber.NOT_SIMULATED, text)
        placed = self.world.placed(points, steps=name in ('bgo', 'bmove'))
        arch = numbers.get('c', GATE)
        if arch in self.world.arches:
            numbers |= zip(('depart', 'approach'), self.world.arches[int(arch)], strict=True)
        elif arch != GATE:
            raise SpelError(ErrorNumber.ARGUMENT, f'C{arch:g}: must be C0 to C{GATE}')
        request = MotionRequest(name, placed, words=words, numbers=numbers, **modifiers)
        completion = self.world.host.move(request)
        self.world.mover = self
        if beside is None:
            self.wait_for(completion)
            return
        helper = self.world.add_helper(self, beside, completion)

        def after(_timed_out: bool) -> None:
            error = completion.error or helper.error
            if error is not None:
                raise SpelError(error.number, error.text)

        self.wait(None, lambda: completion.done and helper.frame is None, after)

    def wait_fraction(self, percent: float) -> None:
        """Wait until `percent` of a motion are complete.

        The task that executes the motion's parallel statements calls this.
        """
        motion = self.motion
        assert motion is not None  # noqa: S101 - the compiler puts it into !…! only
        fraction = min(max(percent / 100.0, 0.0), 1.0)
        self.wait(None, lambda: motion.done or motion.fraction >= fraction, scanned=True)

    # Statements and functions that are not simulated

    def stub(self, name: str, arguments: tuple[Any, ...]) -> None:
        self.since_wait = 0
        references = [argument for argument in arguments if isinstance(argument, tuple)]
        answer = self.world.stubs.answer(name, self._shown(arguments))
        if answer is None:
            return
        values = answer if isinstance(answer, list) else [answer]
        for (container, index, type_name), value in zip(references, values, strict=False):
            container[index] = store(value, type_name)

    def ask(self, name: str, arguments: tuple[Any, ...], kind: str) -> Value | Point:
        answer = self.world.stubs.answer(name, self._shown(arguments))
        if kind == POINT:
            values = answer if isinstance(answer, list) else []
            return Point('xy', (*map(float, values), *[0.0] * (6 - len(values))))
        if isinstance(answer, list) or answer is None:
            answer = answer[0] if answer else 0
        if kind == STRING:
            return str(answer)
        number = float(answer)
        return nearest(number) if kind == INT else number

    def _shown(self, arguments: tuple[Any, ...]) -> list[object]:
        return [
            argument[0][argument[1]] if isinstance(argument, tuple) else argument
            for argument in arguments
        ]

    def library(self, number: int, arguments: tuple[object, ...]) -> Value:
        """Call a function of a DLL, which may write to arrays and to ByRef variables."""
        declared = self.world.program.libraries[number]
        passed: list[Value | Array] = []
        references: list[tuple[Array, list[Value], int]] = []
        for parameter, argument in zip(declared.parameters, arguments, strict=True):
            if isinstance(argument, tuple):
                container, index = argument
                array = Array(parameter.type, (0,))
                array.d[0] = container[index]
                references.append((array, container, index))
                passed.append(array)
            else:
                passed.append(argument)  # type: ignore[arg-type]
        result = self.world.host.call_library(declared.library, declared.alias, passed)
        for array, container, index in references:
            container[index] = store(array.d[0], array.type)
        return store(result, declared.result)

    def xqt(self, number: int, linked: Linked, arguments: list[object], kind: int) -> None:
        """Start a task. Raises SpelError if its number is in use or out of range.

        `number` 0 selects a free number. A background task starts only background tasks.
        """
        self.may('xqt')
        background = self.type is TaskType.BACKGROUND
        if number == 0:
            number = self.world.free_number(background)
        first, last = (FIRST_BACKGROUND, LAST_BACKGROUND) if background else (1, LAST_NORMAL)
        if not first <= number <= last:
            text = f'task {number} is not in {first}..{last}'
            raise SpelError(ErrorNumber.TASK_NUMBER, text)
        self.world.add(
            number, linked, arguments, TaskType.BACKGROUND if background else TaskType(kind)
        )

    @property
    def suspended(self) -> bool:
        return self.halted or self.paused or self.interrupted_by is not None

    @property
    def state(self) -> TaskState:
        if self.halted or self.paused:
            return TaskState.HALTED
        return TaskState.RUNNING if self.waiting is None else TaskState.WAITING
