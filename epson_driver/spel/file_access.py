# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Statements and functions of files, numbers 30 to 63: opening, reading, writing, folders."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from pathlib import PurePosixPath
from typing import Any

from epson_driver.spel.errors import bad
from epson_driver.spel.files import no_file
from epson_driver.spel.ranges import FILES
from epson_driver.spel.task import OpenFile, Task
from epson_driver.spel.values import nearest

FIRST_FILE, LAST_FILE = FILES
LINE_END = b'\r\n'
_END_OF_FILE = 26


@dataclass(frozen=True, slots=True)
class _Mode:
    """A mode of opening a file.

    `must`: the file must exist. `empty`: it is truncated. Otherwise it is created if missing.
    """

    reads: bool
    writes: bool
    must: bool = False
    empty: bool = False


_MODES = {
    'aopen': _Mode(reads=False, writes=True),
    'bopen': _Mode(reads=True, writes=True),
    'ropen': _Mode(reads=True, writes=False, must=True),
    'uopen': _Mode(reads=True, writes=True, must=True),
    'wopen': _Mode(reads=False, writes=True, empty=True),
}


def is_file(number: float) -> bool:
    """Return whether a number after # is a file number."""
    return FIRST_FILE <= number <= LAST_FILE


def opened(task: Task, name: str, number: int) -> OpenFile:
    """Return an open file. Raises SpelError."""
    result = task.world.open_files.get(number)
    if result is None:
        raise bad(name, f'file {number} is not open')
    return result


def _open(way: str) -> Callable[[Task, str, int], None]:
    mode, word = _MODES[way], f'{way[0].upper()}Open'

    def run(task: Task, name: str, number: int) -> None:
        if number in task.world.open_files:
            raise bad(word, f'file {number} is already open')
        content = task.world.files.read(name)
        if content is None and mode.must:
            raise no_file(name)
        data = bytearray(b'' if mode.empty else content or b'')
        at = len(data) if way == 'aopen' else 0
        file = OpenFile(name, data, at, mode.reads, mode.writes)
        task.world.open_files[number] = file
        if content is None or mode.empty:
            task.world.files.write(name, bytes(data))

    return run


def close(task: Task, number: float) -> None:
    """Close #n."""
    flush(task, number)
    del task.world.open_files[nearest(number)]


def flush(task: Task, number: float) -> None:
    """Flush #n."""
    file = opened(task, 'Flush', nearest(number))
    if file.writes:
        task.world.files.write(file.name, bytes(file.data))


def seek(task: Task, number: float, at: float) -> None:
    """Seek #n, pointer: bytes from the start of the file."""
    file = opened(task, 'Seek', nearest(number))
    if not 0 <= at <= len(file.data):
        raise bad('Seek', f'{nearest(at)} is not in 0..{len(file.data)}')
    file.at = nearest(at)


def write(task: Task, name: str, number: int, data: bytes) -> None:
    """Write bytes to a file. Raises SpelError."""
    file = opened(task, name, number)
    if not file.writes:
        raise bad(name, f'file {number} is open for reading')
    file.data[file.at : file.at + len(data)] = data
    file.at += len(data)
    if len(file.data) > task.world.files.most_bytes:
        raise bad(name, f'file {number} is larger than {task.world.files.most_bytes} bytes')
    task.since_wait += len(data)


def read(task: Task, name: str, number: int, count: int | None) -> bytes:
    """Return the next bytes of a file, or its next line without its end. Raises SpelError."""
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


def _rename(task: Task, source: str, target: str) -> None:
    _copy(task, source, target)
    task.world.files.delete(source)


def _change_folder(task: Task, name: str) -> None:
    files = task.world.files
    if not files.has_folder(name):
        raise bad('ChDir', f'there is no folder {name}')
    files.current = files.path(name)


def _free(task: Task) -> int:
    for number in range(FIRST_FILE, LAST_FILE + 1):
        if number not in task.world.open_files:
            return number
    raise bad('FreeFile', 'all files are open')


def _length(task: Task, name: str) -> int:
    content = task.world.files.read(name)
    if content is None:
        raise no_file(name)
    return len(content)


def _changed(task: Task, name: str) -> str:
    now = task.world.started + timedelta(seconds=task.world.time)
    return task.world.files.changed(name, now).strftime('%Y/%m/%d %H:%M:%S')


def _at_end(task: Task, number: int) -> int:
    file = opened(task, 'Eof', number)
    return -1 if file.at >= len(file.data) or file.data[file.at] == _END_OF_FILE else 0


FILE_STATEMENTS: dict[str, Callable[..., None]] = {
    **{way: _open(way) for way in _MODES},
    'close': close,
    'flush': flush,
    'seek': seek,
    'copy': _copy,
    'rename': _rename,
    'del': lambda task, name: task.world.files.delete(name),
    'rendir': lambda task, source, target: task.world.files.rename_folder(source, target),
    'mkdir': lambda task, name: task.world.files.make_folder(name),
    'rmdir': lambda task, name: task.world.files.remove_folder(name),
    'chdir': _change_folder,
}
"""Name of the statement in lower case → function that executes it."""

FILE_FUNCTIONS: dict[str, Callable[..., Any]] = {
    'freefile': _free,
    'eof': _at_end,
    'fileexists': lambda task, name: -(task.world.files.read(name) is not None),
    'filelen': _length,
    'filedatetime$': _changed,
    'folderexists': lambda task, name: -task.world.files.has_folder(name),
    'curdir$': lambda task: str(PurePosixPath('/', task.world.files.current)),
}
"""Name of the function in lower case → its implementation."""
