# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Read files of bounded size, and refuse pipes and devices, which may never end."""

import os
import stat
from pathlib import Path

from epson_driver.inputs.rules import InputError, printable

MEGABYTE = 1_000_000


def read_file(path: Path, largest: int) -> bytes:
    """Return the content of a file of at most `largest` bytes.

    Raises InputError for everything else: a file that does not exist or may not be read, a folder,
    a pipe or a device (which could block, or never end), and a path that is not valid.
    """
    name = printable(path)
    try:
        # O_NONBLOCK: opening a pipe would wait for somebody to write into it
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise InputError(f'{name}: {error.strerror or error}') from error
    except ValueError as error:  # a NUL, or characters that the file system cannot encode
        raise InputError(f'{name}: cannot be the path of a file') from error
    try:
        mode = os.fstat(number).st_mode
        if not stat.S_ISREG(mode):
            kind = 'a folder' if stat.S_ISDIR(mode) else 'a pipe or a device'
            raise InputError(f'{name}: is {kind}, not a file')
        with open(number, 'rb', closefd=False) as file:
            content = file.read(largest + 1)
    except OSError as error:
        raise InputError(f'{name}: {error.strerror or error}') from error
    finally:
        os.close(number)
    if len(content) > largest:
        raise InputError(f'{name}: is larger than {largest / MEGABYTE:g} MB')
    return content
