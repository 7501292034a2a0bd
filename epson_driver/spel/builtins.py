# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Functions that need the task or the host: time, tasks, errors, bits, ports, points."""

from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Any

from epson_driver.spel.commands import TaskType
from epson_driver.spel.errors import ErrorNumber, SpelError, TaskError
from epson_driver.spel.host import Memory
from epson_driver.spel.ports import check_net, lines_waiting, port_of
from epson_driver.spel.task import Task, TaskState
from epson_driver.spel.values import Point


def timer(task: Task, number: int) -> float:
    """Return `Tmr(n)`: time since `TmReset n`, or since the start, s, in steps of 1 ms."""
    started = task.world.timers.get(number, 0.0)
    return round(task.world.time - started, 3)


def now(task: Task) -> datetime:
    return datetime(2000, 1, 1) + timedelta(seconds=task.world.time)


def _time(task: Task, unit: int) -> int:
    clock = now(task)
    return (clock.hour, clock.minute, clock.second)[unit]


def point(task: Task, number: int) -> Point:
    world = task.world
    result = world.points.get(number)
    if result is None:
        labels = (key for key, value in world.point_labels.items() if value == number)
        name = next((world.spelling.get(key, key) for key in labels), f'P{number}')
        raise SpelError(ErrorNumber.POINT_UNDEFINED, f'{name} is not defined')
    return result


def _place(task: Task, number: int, position: int, row: int | None = None) -> Point:
    result = task.world.pallets.get(number)
    if result is None:
        raise SpelError(ErrorNumber.POINT_UNDEFINED, f'Pallet {number} is not defined')
    return result.place(number, position, row)


def task_state(task: Task, which: int | str) -> int:
    result = task.world.task(which)
    if result is not None:
        return result.state
    if isinstance(which, int) and which in task.world.aborted:
        return TaskState.ABORTED
    return TaskState.NOT_RUNNING


def _task_info(task: Task, which: int | str, index: int) -> int:
    result = task.world.task(which)
    if result is None:
        raise SpelError(ErrorNumber.NO_SUCH_TASK, f'TaskInfo: task {which} does not exist')
    states = (
        result.number,
        int(result.type is not TaskType.BACKGROUND),
        int(result.type),
        int(result.state),
        -1 if result.timed_out else 0,
    )
    return states[index]


def _error(task: Task, which: int | str | None) -> TaskError | None:
    if not which:  # 0 is this task
        return task.error
    result = task.world.task(which)
    if result is None:
        raise SpelError(ErrorNumber.NO_SUCH_TASK, f'task {which} does not exist')
    return result.error


def _of_error(read: Callable[[TaskError], Any], blank: int | str) -> Callable[..., Any]:
    def ask(task: Task, which: int | str | None = None) -> Any:
        error = _error(task, which)
        return read(error) if error is not None else blank

    return ask


def _net_owner(task: Task, number: int) -> int:
    return port_of(task, 'OpenNet', number).owner


def _bits(memory: Memory, width: int) -> Callable[[Task, int], int]:
    def read(task: Task, index: int) -> int:
        task.since_wait = 0  # a loop that reads inputs is not endless
        return task.world.host.read_bits(memory, index, width)

    return read


def _done(task: Task, which: int | str) -> int:
    return -1 if task.world.task(which) is None else 0


TASK_FUNCTIONS: dict[str, Callable[..., Any]] = {
    'rnd': lambda task, most: task.world.random.uniform(0.0, most),
    'p': point,
    'pallet': _place,
    'pdef': lambda task, number: -1 if number in task.world.points else 0,
    'tmr': timer,
    'elapsedtime': lambda task: round(task.world.time - task.world.elapsed_from, 3),
    'time': _time,
    'date$': lambda task: now(task).strftime('%Y/%m/%d'),
    'time$': lambda task: now(task).strftime('%H:%M:%S'),
    'tw': lambda task: -1 if task.timed_out else 0,
    'mytask': lambda task: task.number,
    'taskstate': task_state,
    'taskinfo': _task_info,
    'taskdone': _done,
    'err': _of_error(lambda error: error.number, 0),
    'erl': _of_error(lambda error: error.position.line, 0),
    'era': lambda _task, _which=None: 0,
    'ert': lambda task: task.error.task if task.error is not None else 0,
    'erf$': _of_error(lambda error: error.function, ''),
    'errmsg$': lambda task, number, _language=0: task.world.error_text(number),
    'chknet': check_net,
    'opennet': _net_owner,
    'lof': lines_waiting,
    'sw': _bits(Memory.INPUT, 1),
    'in': _bits(Memory.INPUT, 8),
    'inw': _bits(Memory.INPUT, 16),
    'oport': _bits(Memory.OUTPUT, 1),
    'out': _bits(Memory.OUTPUT, 8),
    'outw': _bits(Memory.OUTPUT, 16),
    'memsw': _bits(Memory.MEMORY, 1),
    'memin': _bits(Memory.MEMORY, 8),
    'meminw': _bits(Memory.MEMORY, 16),
}
"""Name of a SPEL+ function in lower case → Python function. These are the functions that
functions.py marks with 'task'."""
