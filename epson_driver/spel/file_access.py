# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Statements and functions for files, which have the numbers 30 to 63."""

from collections.abc import Callable
from typing import Any

from epson_driver.spel.errors import bad
from epson_driver.spel.files import no_file
from epson_driver.spel.ranges import FILES
from epson_driver.spel.task import OpenFile, Task
from epson_driver.spel.values import nearest

FIRST_FILE, LAST_FILE = FILES
LINE_END = b'\r\n'
_END_OF_FILE = 26


def is_file(number: float) -> bool:
    return FIRST_FILE <= number <= LAST_FILE


def opened(task: Task, name: str, number: int) -> OpenFile:
    result = task.world.open_files.get(number)
    if result is None:
        raise bad(name, f'file {number} is not open')
    return result


def _open(mode: str) -> Callable[[Task, str, int], None]:
    """Return the function of a statement that opens a file.

    `AOpen` appends to the file, `ROpen` reads it, and `WOpen` empties it.
    """

    def run(task: Task, name: str, number: int) -> None:
        if number in task.world.open_files:
            raise bad(f'{mode[0].upper()}Open', f'file {number} is already open')
        content = task.world.files.read(name)
        if content is None and mode == 'ropen':
            raise no_file(name)
        data = bytearray(b'' if mode == 'wopen' else content or b'')
        at = len(data) if mode == 'aopen' else 0
        task.world.open_files[number] = OpenFile(name, data, at, mode == 'ropen')
        if content is None or mode == 'wopen':
            task.world.files.write(name, bytes(data))

    return run


def close(task: Task, number: float) -> None:
    if not opened(task, 'Close', nearest(number)).reads:
        flush(task, number)
    del task.world.open_files[nearest(number)]


def flush(task: Task, number: float) -> None:
    file = opened(task, 'Flush', nearest(number))
    if file.reads:
        raise bad('Flush', f'file {number:g} is open for reading')
    task.world.files.write(file.name, bytes(file.data))


def write(task: Task, name: str, number: int, data: bytes) -> None:
    file = opened(task, name, number)
    if file.reads:
        raise bad(name, f'file {number} is open for reading')
    file.data[file.at : file.at + len(data)] = data
    file.at += len(data)
    if len(file.data) > task.world.files.most_bytes:
        raise bad(name, f'file {number} is larger than {task.world.files.most_bytes} bytes')
    task.since_wait += len(data)


def read(task: Task, name: str, number: int, count: int | None) -> bytes:
    """Return the next `count` bytes of a file.

    If `count` is None, return the next line without its line end. Raises SpelError at the end of
    the file, or if the file is not open for reading.
    """
    file = opened(task, name, number)
    if not file.reads:
        raise bad(name, f'file {number} is open for writing')
    if file.at >= len(file.data):
        raise bad(name, f'the end of file {number} is reached: check Eof')
    if count is not None:
        data = bytes(file.data[file.at : file.at + count])
        file.at += len(data)
        return data
    end = file.data.find(b'\n', file.at)
    end = len(file.data) if end < 0 else end + 1
    line = bytes(file.data[file.at : end])
    file.at = end
    return line.rstrip(LINE_END)


def _copy(task: Task, source: str, target: str) -> None:
    content = task.world.files.read(source)
    if content is None:
        raise no_file(source)
    task.world.files.write(target, content)


def _free(task: Task) -> int:
    for number in range(FIRST_FILE, LAST_FILE + 1):
        if number not in task.world.open_files:
            return number
    raise bad('FreeFile', 'all files are open')


def _at_end(task: Task, number: int) -> int:
    file = opened(task, 'Eof', number)
    if not file.reads:
        raise bad('Eof', f'file {number} is open for writing')
    return -1 if file.at >= len(file.data) or file.data[file.at] == _END_OF_FILE else 0


FILE_STATEMENTS: dict[str, Callable[..., None]] = {
    **{mode: _open(mode) for mode in ('aopen', 'ropen', 'wopen')},
    'close': close,
    'flush': flush,
    'copy': _copy,
    'del': lambda task, name: task.world.files.delete(name),
}

FILE_FUNCTIONS: dict[str, Callable[..., Any]] = {
    'freefile': _free,
    'eof': _at_end,
    'fileexists': lambda task, name: -(task.world.files.read(name) is not None),
}
