# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Statements that the interpreter executes itself: waiting, tasks, locks, bits, terminal."""

import math
from collections.abc import Callable

from epson_driver.spel.commands import TaskType
from epson_driver.spel.errors import ErrorNumber, SpelError, bad
from epson_driver.spel.frames import in_local, new_pallet
from epson_driver.spel.host import Memory
from epson_driver.spel.library import format_string, parse_string, value_of
from epson_driver.spel.project_data import LAST_POINT
from epson_driver.spel.scope import LIMITS
from epson_driver.spel.task import (
    Linked,
    Reference,
    Task,
    Test,
    Trap,
)
from epson_driver.spel.values import (
    STRING,
    TYPES,
    Array,
    Point,
    Value,
    nearest,
    shown,
    size,
    store,
)


def seconds(task: Task, time: float) -> float:
    """Return a waiting time, s, rounded up to whole time units of the controller."""
    tick = task.world.timing.granularity
    return math.ceil(time / tick - 1e-9) * tick if tick else time


def within(name: str, number: int, least: int, most: int) -> int:
    if not least <= number <= most:
        raise bad(name, f'{shown(number)} is not in {least}..{most}')
    return number


# Waiting


def wait(task: Task, time: float) -> None:
    task.wait(seconds(task, time))


def wait_condition(task: Task, test: Test, time: float | None) -> None:
    """Execute `Wait condition[, time]`: wait until `test` holds or `time`, s, has passed.

    After a timeout, the program's function `TW` returns True. If `time` is None and `TMOut` has
    set a default timeout, SpelError is raised after this timeout.
    """
    limit = task.default_timeout if time is None else seconds(task, time)

    def after(timed_out: bool) -> None:
        if timed_out and time is None:
            raise SpelError(ErrorNumber.WAIT_TIMEOUT)

    task.wait_or_time_out(limit, test, after, scanned=True)


def set_default_timeout(task: Task, time: float) -> None:
    task.default_timeout = seconds(task, time) or None


def wait_signal(task: Task, number: int, time: float | None = None) -> None:
    number, signals = nearest(number), task.world.signals
    before = signals.get(number, 0)
    limit = None if time is None else seconds(task, time)
    task.wait_or_time_out(limit, lambda: signals.get(number, 0) != before)


def signal(task: Task, number: int) -> None:
    number, signals = nearest(number), task.world.signals
    signals[number] = signals.get(number, 0) + 1


def sync_lock(task: Task, number: int, time: float | None = None) -> None:
    number = nearest(number)
    locks = task.world.locks
    if locks.get(number) == task.number:
        raise SpelError(ErrorNumber.SYNC, f'SyncLock {number}: this task has already locked it')

    def after(timed_out: bool) -> None:
        if not timed_out:
            locks[number] = task.number

    limit = None if time is None else seconds(task, time)
    task.wait_or_time_out(limit, lambda: number not in locks, after)


def sync_unlock(task: Task, number: int) -> None:
    number = nearest(number)
    if task.world.locks.get(number) != task.number:
        raise SpelError(ErrorNumber.SYNC, f'SyncUnlock {number}: this task has not locked it')
    del task.world.locks[number]


def reset_timer(task: Task, number: int) -> None:
    task.world.timers[nearest(number)] = task.world.time


def reset_elapsed_time(task: Task) -> None:
    task.world.elapsed_from = task.world.time


def randomize(task: Task, seed: float | None = None) -> None:
    task.world.random.seed(0 if seed is None else seed)


# Tasks


def _other(task: Task, which: int | str) -> Task:
    result = task.world.task(which)
    if result is None:
        raise SpelError(ErrorNumber.NO_SUCH_TASK, f'task {which} does not exist')
    return result


def quit_task(task: Task, which: int | str | None) -> None:
    world = task.world
    if which is not None:
        if (result := world.task(which)) is not None:
            world.end(result)
        return
    for item in list(world.tasks.values()):
        if item.type is not TaskType.BACKGROUND:
            world.end(item)
    world.host.command('quit all', (), ())


def halt(task: Task, which: int | str) -> None:
    _other(task, which).halted = True


def resume(task: Task, which: int | str | None) -> None:
    for item in task.world.tasks.values() if which is None else [_other(task, which)]:
        item.halted = False


def task_wait(task: Task, which: int | str | None) -> None:
    result = task.world.task(which) if which is not None else None
    if result is not None:
        task.wait(None, lambda: result.frame is None)


def start_main(task: Task, which: int | str | None) -> None:
    task.may('startmain')
    if not isinstance(which, str):
        raise bad('StartMain', 'needs the name of a main function')
    main = task.world.function(which)
    task.world.host.command('startmain', (), ())
    task.world.add(1, main, (), TaskType.NORMAL)


def pause_all(task: Task) -> None:
    for item in task.world.tasks.values():
        item.paused = item.type is TaskType.NORMAL
    task.world.host.paused(True)


def continue_all(task: Task) -> None:
    task.world.host.paused(False)


def raise_error(task: Task, first: float, second: float | None = None) -> None:
    """Execute `Error n` or `Error task, n`: raise error n here, or in another task (0: here)."""
    if second is None:
        number = within('Error', nearest(first), 1, 9999)
        raise SpelError(number, task.world.error_text(number))
    number = within('Error', nearest(second), 1, 9999)
    error = SpelError(number, task.world.error_text(number))
    other = _other(task, nearest(first) or task.number)
    if other is task:
        raise error
    other.fail(error)


def set_trap(
    task: Task,
    event: str,
    number: int | None,
    test: Test | None,
    target: Linked | int | None,
    action: str,
) -> None:
    """Execute `Trap n, condition …` or `Trap event Xqt f`. Without a `target`, disarm the Trap.

    `action` is GoTo, Call or Xqt. GoTo and Call interrupt the current statement of the task. With
    Call, the task then waits until the function `target` has ended. Xqt starts this function as
    another task.
    """
    task.may('trap')
    world = task.world
    if event:
        world.event_traps.pop(event, None)
        if isinstance(target, Linked):
            world.event_traps[event] = target
        return
    index = within('Trap', number or 0, 1, 4)
    world.traps.pop(index, None)
    if target is not None and test is not None:
        world.traps[index] = Trap(task, test, target, action, task.frame)


def store_condition(task: Task, name: str, test: Test) -> None:
    task.may(name)
    task.world.conditions[name] = test


# Bits


def _may_write(task: Task, name: str, memory: Memory, words: tuple[str, ...]) -> None:
    """Raise SpelError if outputs must not be set without `Forced` now (E-stop or open door)."""
    if memory is not Memory.OUTPUT or 'forced' in words:
        return
    host = task.world.host
    if host.value('estopon', ()) or host.value('safetyon', ()):
        text = f'{name}: outputs need the parameter Forced during an E-stop or with an open door'
        raise SpelError(ErrorNumber.TASK_TYPE, text)


def _bits(name: str, memory: Memory, width: int, switch: int | None) -> Callable[..., None]:
    """Return the function that executes a bit statement `name`.

    `switch`: 1 for `On`, 0 for `Off`, None for a statement with a value, such as `Out`.
    """

    def one(
        task: Task,
        index: float,
        time: float | None = None,
        parallel: float | None = None,
        words: tuple[str, ...] = (),
    ) -> None:
        _may_write(task, name, memory, words)
        host, bit, number = task.world.host, switch or 0, nearest(index)
        host.write_bits(memory, number, width, bit)
        if time is None:
            return

        def after(_timed_out: bool) -> None:
            host.write_bits(memory, number, width, 1 - bit)

        duration = seconds(task, time)
        if parallel == 0:  # the next statement does not wait (p560, p567)
            task.world.later.append((task.world.time + duration, lambda: after(True)))
        else:
            task.wait(duration, after=after)

    def many(task: Task, index: float, value: float, words: tuple[str, ...] = ()) -> None:
        _may_write(task, name, memory, words)
        bits = nearest(value) & ((1 << width) - 1)
        task.world.host.write_bits(memory, nearest(index), width, bits)

    return many if switch is None else one


# Terminal


def message_box(
    task: Task,
    text: str,
    buttons: float | None = None,
    title: str | None = None,
    answer: Reference | None = None,
) -> None:
    world, caller = task.world, task.caller
    pressed: list[int] = []

    def asked() -> bool:
        button = world.host.terminal.message_box(caller, text, nearest(buttons or 0), title or '')
        if button is not None:
            pressed.append(button)
        return button is not None

    def after(_timed_out: bool) -> None:
        if answer is not None:
            container, index, type_name = answer
            container[index] = store(pressed[0], type_name)

    task.wait(None, asked, after)


def print_terminal(task: Task, text: str) -> None:
    if task.output is None:
        task.world.host.terminal.write(task.caller, text)
    else:
        task.output.append(text)


def fill(name: str, line: str, targets: tuple[Reference, ...], whole: bool) -> None:
    """Store an input line in the variables `targets`.

    If `whole` is set, the line is not split. Otherwise it is split at commas and spaces.
    """
    if whole:
        parts = [line]
    elif len(targets) == 1 and TYPES[targets[0][2]].kind == STRING:
        parts = [line.strip()]
    else:
        parts = line.replace(',', ' ').split()
    if len(parts) != len(targets):
        text = f'{name}: {len(parts)} values for {len(targets)} variables'
        raise SpelError(ErrorNumber.INPUT_COUNT, text)
    for (container, index, type_name), part in zip(targets, parts, strict=True):
        kind = TYPES[type_name].kind
        container[index] = store(part if kind == STRING else value_of(part), type_name)


def input_terminal(task: Task, targets: tuple[Reference, ...], whole: bool) -> None:
    typed: list[str] = []

    def asked() -> bool:
        line = task.world.host.terminal.read_line()
        if line is not None:
            typed.append(line)
        return line is not None

    task.wait(None, asked, lambda _: fill('Input', typed[0], targets, whole))


# Variables


def redim(
    _task: Task, array: Array, bounds: tuple[int, ...], preserve: bool, shared: bool
) -> None:
    numbers, strings = LIMITS['global' if shared else 'local']
    maximum = strings if TYPES[array.type].kind == STRING else numbers
    if min(bounds) < 0 or size(bounds) > maximum:
        raise bad('Redim', f'bounds {bounds} are below 0 or give more than {maximum} elements')
    array.resize(bounds, preserve)


def parse_into(_task: Task, text: str, into: Array, delimiters: str) -> None:
    parse_string(text, into, delimiters)


def format_into(_task: Task, value: Value, form: str, into: Reference) -> None:
    """Execute `FmtStr value, form, into` (SPEL+ manual p337)."""
    container, index, type_name = into
    container[index] = store(format_string(value, form), type_name)


def set_point(task: Task, number: int, point: Point) -> None:
    world = task.world
    world.points[within('P', number, 0, LAST_POINT)] = world.host.stored_point(point)


def define_pallet(
    task: Task, number: int, *arguments: Point | int, words: tuple[str, ...] = ()
) -> None:
    world = task.world
    corners = tuple(world.host.stored_point(item) for item in arguments if isinstance(item, Point))
    columns, rows = (item for item in arguments if not isinstance(item, Point))
    world.pallets[number] = new_pallet(corners, columns, rows, 'outside' in words)


def clear_pallet(task: Task, number: float) -> None:
    task.world.pallets.pop(nearest(number), None)


def where(task: Task, local: float | None = None) -> None:
    """Execute `Where [local]`: print the position of the robot (SPEL+ manual p890)."""
    here = task.world.host.value('here', ())
    assert isinstance(here, Point)  # noqa: S101 - Here is one
    here = in_local(here, nearest(local or 0), task.world.locals)
    print_terminal(task, f'{task.world.host.value("where", (here,))}\n')


STATEMENTS: dict[str, Callable[..., None]] = {
    'wait': wait,
    'waitcondition': wait_condition,
    'tmout': set_default_timeout,
    'waitsig': wait_signal,
    'signal': signal,
    'synclock': sync_lock,
    'syncunlock': sync_unlock,
    'tmreset': reset_timer,
    'resetelapsedtime': reset_elapsed_time,
    'randomize': randomize,
    'quit': quit_task,
    'halt': halt,
    'resume': resume,
    'taskwait': task_wait,
    'startmain': start_main,
    'pause': pause_all,
    'cont': continue_all,
    'error': raise_error,
    'trap': set_trap,
    'store': store_condition,
    'on': _bits('On', Memory.OUTPUT, 1, 1),
    'off': _bits('Off', Memory.OUTPUT, 1, 0),
    'out': _bits('Out', Memory.OUTPUT, 8, None),
    'outw': _bits('OutW', Memory.OUTPUT, 16, None),
    'memon': _bits('MemOn', Memory.MEMORY, 1, 1),
    'memoff': _bits('MemOff', Memory.MEMORY, 1, 0),
    'memout': _bits('MemOut', Memory.MEMORY, 8, None),
    'memoutw': _bits('MemOutW', Memory.MEMORY, 16, None),
    'setsw': _bits('SetSw', Memory.INPUT, 1, None),
    'setin': _bits('SetIn', Memory.INPUT, 8, None),
    'setinw': _bits('SetInW', Memory.INPUT, 16, None),
    'msgbox': message_box,
    'pallet': define_pallet,
    'palletclr': clear_pallet,
    'redim': redim,
    'parsestr': parse_into,
    'fmtstr': format_into,
    'where': where,
    'joint': lambda task: print_terminal(task, f'{task.world.host.value("joint", ())}\n'),
}
"""Name of a statement in lower case → function that executes it. The network statements, Print and
Input are in ports.py."""
