# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A child process that computes: values come to its stdin, and answers from its stdout."""

import asyncio
import contextlib
import json
import math
import os
import signal
import struct
import zlib
from collections.abc import Collection
from typing import Any, BinaryIO

import numpy as np

from epson_driver.processes.command import module_command
from epson_driver.processes.standard_streams import open_closed_streams

PREFIX = struct.Struct('=IIQ')
"""The checksum of what follows, and how many bytes are the text and the arrays."""

MAX_BYTES = 2**31
"""More than any trajectory has: the number that says so is a wrong one."""

_ARRAY = 'array'
_DTYPES = {np.dtype(kind).str for kind in (float, int, bool)}
_ALIGNMENT = 8
"""Arrays begin at multiples of it, as the processor likes its numbers."""


def packed(value: object) -> bytes:
    """Return a value as bytes, of which nothing is executed when they are read.

    A value is None, a bool, a number, a text, a numpy array of numbers, or a tuple or dataclass of
    such. Its bytes are a prefix, a JSON text, and the numbers of all arrays; the text says where
    each begins. Raises TypeError that says what in it cannot be passed.
    """
    arrays: list[bytes] = []
    used = 0

    def plain(part: Any) -> Any:
        nonlocal used
        if not isinstance(part, np.ndarray):
            return _fields(part)
        dtype, begin, numbers = part.dtype.str, used, part.tobytes()
        if dtype not in _DTYPES:
            raise TypeError(f'an array of {part.dtype} cannot be passed')
        used += len(numbers)
        arrays.append(numbers)
        if rest := -used % _ALIGNMENT:
            used += rest
            arrays.append(bytes(rest))
        return {_ARRAY: (dtype, part.shape, begin)}

    text = json.dumps(value, check_circular=False, default=plain).encode()
    body = b''.join([text, bytes(-len(text) % _ALIGNMENT), *arrays])
    return PREFIX.pack(zlib.crc32(body), len(body) - used, used) + body


def body_length(prefix: bytes) -> int:
    """Return how many bytes follow on a prefix. Raises ValueError if that cannot be."""
    _, text, arrays = PREFIX.unpack(prefix)
    length = int(text + arrays)
    if length > MAX_BYTES:
        raise ValueError(f'a value of {length} bytes: at most {MAX_BYTES} can be')
    return length


def unpacked(data: bytes, kinds: Collection[type]) -> Any:
    """Return the value of bytes that `packed` made, with no dataclasses but these.

    Raises ValueError that says what is wrong with the bytes.
    """
    names = {kind.__name__: kind for kind in kinds}

    def restored(part: dict[str, Any]) -> Any:
        ((name, values),) = part.items()
        if name != _ARRAY:
            return names[name](*map(_tuple, values))
        dtype, shape, begin = values
        if dtype not in _DTYPES:
            raise TypeError(f'an array of {dtype}')
        return np.frombuffer(arrays, dtype, math.prod(shape), begin).reshape(shape)

    try:
        checksum, text_length, length = PREFIX.unpack_from(data)
        body = memoryview(data)[PREFIX.size :]
        if len(body) != text_length + length or zlib.crc32(body) != checksum:
            raise ValueError('length or checksum is wrong')
        arrays = bytearray(body[text_length:])  # so that the arrays can be written to
        text = bytes(body[:text_length]).rstrip(b'\0')
        return _tuple(json.loads(text, object_hook=restored))
    except (
        struct.error,
        ArithmeticError,
        LookupError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        raise ValueError(f'{len(data)} bytes that are no value: {error}') from error


def read_value(stream: BinaryIO, kinds: Collection[type]) -> Any:
    """Return the next value of a stream, None at its end. Raises as `unpacked`."""
    prefix = stream.read(PREFIX.size)
    if len(prefix) < PREFIX.size:
        return None
    body = stream.read(length := body_length(prefix))
    return unpacked(prefix + body, kinds) if len(body) == length else None


def write_value(stream: BinaryIO, value: object) -> None:
    """Write a value, at once."""
    stream.write(packed(value))
    stream.flush()


async def next_value(stream: asyncio.StreamReader, kinds: Collection[type]) -> Any:
    """Return the next value of a stream. Raises EOFError at its end, else as `unpacked`."""
    prefix = await stream.readexactly(PREFIX.size)
    body = await stream.readexactly(body_length(prefix))
    return unpacked(prefix + body, kinds)


def _fields(value: Any) -> Any:
    """Return a dataclass by the name of its type, and a number of numpy as Python has it."""
    if isinstance(value, np.generic):
        return value.item()
    try:
        return {type(value).__name__: [getattr(value, name) for name in value.__match_args__]}
    except AttributeError:
        raise TypeError(f'a {type(value).__name__} cannot be passed') from None


def _tuple(value: Any) -> Any:
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


_THREADS = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')
"""Thread counts of the numeric libraries, one each: the matrices are small, and threads that spin
would take the time of what has to be punctual."""


async def start_worker(module: str, stderr: int | None = None) -> asyncio.subprocess.Process:
    """Start a module of this package, with pipes to its stdin and stdout. Raises OSError."""
    return await asyncio.create_subprocess_exec(
        *module_command(module),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=stderr,
        env=os.environ | dict.fromkeys(_THREADS, '1'),
        start_new_session=True,  # Ctrl-C is for its parent to handle
    )


async def until_done(task: 'asyncio.Task[None] | asyncio.Task[int]') -> None:
    """Wait until a task has ended, even if cancelled meanwhile, and raise what it raised.

    For tidying up that must not be left half done, by a task that ends soon.
    """
    canceled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.wait({task})
        except asyncio.CancelledError as error:
            canceled = error
    if canceled is not None:
        raise canceled
    task.result()


async def end_worker(process: asyncio.subprocess.Process) -> None:
    """Kill a worker and wait until it is gone, also where that is cancelled meanwhile."""
    with contextlib.suppress(ProcessLookupError):
        process.kill()
    await until_done(asyncio.create_task(process.wait()))


def answer_file() -> BinaryIO:
    """Return the file for a worker's answers, and redirect what is printed to stderr."""
    open_closed_streams()
    answers = os.fdopen(os.dup(1), 'wb')
    os.dup2(2, 1)
    return answers


def ending(code: int | None) -> str:
    """Return what to say of a worker that has ended with this code."""
    if code is not None and code < 0:
        named = -code in {number.value for number in signal.Signals}  # not those of real time
        return f'was ended by {signal.Signals(-code).name if named else f"signal {-code}"}'
    return f'ended with exit code {code}'
