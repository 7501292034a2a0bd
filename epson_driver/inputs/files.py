# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reads regular files of bounded size, and writes files atomically without following links.

A pipe or a device may block or be endless. The target of a link may have another owner.
"""

import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import BinaryIO

from epson_driver.inputs.rules import FileError, InputError, printable

MEGABYTE = 1_000_000

_MAX_NAMES = 1000
"""Maximum number of names in a folder that are compared with the name of a missing file."""


@contextmanager
def open_file(path: Path) -> Iterator[BinaryIO]:
    """Open a regular file for reading.

    Raises InputError if the file is missing or unreadable, or if it is a folder, a pipe or a
    device.
    """
    try:
        # O_NONBLOCK: otherwise opening a pipe waits for a writer
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        raise InputError(_sentence(path, error)) from error
    try:
        _check_kind(os.fstat(number).st_mode)
        with open(number, 'rb', closefd=False) as file:
            yield file
    except OSError as error:
        raise InputError(_sentence(path, error)) from error
    finally:
        os.close(number)


def read_file(path: Path, largest: int) -> bytes:
    """Return the content of a file.

    Raises InputError if the file has more than `largest` bytes, and the errors of `open_file`.
    """
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        # None: a kernel file without data
        content = b'' if size > largest else file.read(min(largest, size + MEGABYTE) + 1) or b''
    if max(size, len(content)) > largest:
        raise InputError(f'{printable(path)}: is larger than {largest / MEGABYTE:g} MB')
    return content


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file atomically. An existing file is replaced, and its permissions are preserved.

    Text is written as UTF-8. Raises FileError, which names the file, if the path cannot be written
    or is a link, a folder, a pipe or a device.
    """
    data = content.encode('utf-8', 'backslashreplace') if isinstance(content, str) else content
    part = path.parent / f'.{secrets.token_hex(8)}.part'
    try:
        old = path.lstat().st_mode if os.path.lexists(path) else None
        if old is not None:
            _check_kind(old)
        # O_EXCL does not follow links
        number = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            with os.fdopen(number, 'wb') as file:
                if old is not None:
                    os.fchmod(number, stat.S_IMODE(old))
                file.write(data)
                file.flush()
                os.fsync(number)
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
    except (OSError, ValueError) as error:
        raise FileError(_sentence(path, error)) from error


def _check_kind(mode: int) -> None:
    if not stat.S_ISREG(mode):
        kinds = {stat.S_IFDIR: 'a folder', stat.S_IFLNK: 'a link'}
        raise OSError(f'is {kinds.get(stat.S_IFMT(mode), "a pipe or a device")}, not a file')


def _sentence(path: Path, error: OSError | ValueError) -> str:
    """Return the error text for a file. A ValueError means that the path is invalid."""
    why = error.strerror or error if isinstance(error, OSError) else 'cannot be the path of a file'
    return (
        f'{printable(path)}: {why}{_advice(path) if isinstance(error, FileNotFoundError) else ""}'
    )


def _advice(path: Path) -> str:
    """Return the remedy for a missing file: a similar name, or the missing folder."""
    folder = path.parent
    if not folder.is_dir():
        return f'; create the folder {printable(folder)}, or correct the path'
    try:
        names = [item.name for item in islice(folder.iterdir(), _MAX_NAMES)]
    except OSError:
        names = []
    if near := get_close_matches(path.name, names, 1):
        return f'; did you mean {printable(folder / near[0])}?'
    return f'; correct the name or the folder, {printable(folder.absolute())}'
