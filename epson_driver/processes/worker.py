# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A child process for computations. It reads values from stdin, and writes replies to stdout."""

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

from epson_driver.processes.command import module_command, open_closed_streams

PREFIX = struct.Struct('=IIQ')  # checksum of the rest, and lengths of text and arrays, bytes
MAX_BYTES = 2**31  # of a value: it exceeds every trajectory, so a larger number is an error
_ARRAY = 'array'
_DTYPES = {np.dtype(kind).str for kind in (float, int, bool)}
_ALIGNMENT = 8  # alignment of arrays in bytes, for efficient access


def packed(value: object) -> bytes:
    """Return a value as bytes: a prefix, JSON text with the offsets of arrays, and all arrays.

    A value is None, a bool, a number, a text, a numpy array of numbers, or a tuple or dataclass of
    such values. Raises TypeError with the name of an unsupported type.
    """
    arrays: list[bytes] = []
    used = 0

    def plain(part: Any) -> Any:
        nonlocal used
        if not isinstance(part, np.ndarray):
            return _fields(part)
        dtype, start, numbers = part.dtype.str, used, part.tobytes()
        if dtype not in _DTYPES:
            raise TypeError(f'an array of {part.dtype} cannot be passed')
        used += len(numbers)
        arrays.append(numbers)
        if rest := -used % _ALIGNMENT:
            used += rest
            arrays.append(bytes(rest))
        return {_ARRAY: (dtype, part.shape, start)}

    text = json.dumps(value, check_circular=False, default=plain).encode()
    body = b''.join([text, bytes(-len(text) % _ALIGNMENT), *arrays])
    return PREFIX.pack(zlib.crc32(body), len(body) - used, used) + body


def body_length(prefix: bytes) -> int:
    """Return the number of bytes that follow a prefix. Raises ValueError if it is too large."""
    _, text, arrays = PREFIX.unpack(prefix)
    length = int(text + arrays)
    if length > MAX_BYTES:
        raise ValueError(f'a value of {length} bytes, but the limit is {MAX_BYTES}')
    return length


def unpacked(data: bytes, kinds: Collection[type]) -> Any:
    """Return the value that was packed. Raises ValueError if the bytes are invalid.

    kinds: allowed dataclasses.
    """
    names = {kind.__name__: kind for kind in kinds}

    def restored(part: dict[str, Any]) -> Any:
        ((name, values),) = part.items()
        if name != _ARRAY:
            return names[name](*map(_tuple, values))
        dtype, shape, start = values
        if dtype not in _DTYPES:
            raise TypeError(f'an array of {dtype}')
        return np.frombuffer(arrays, dtype, math.prod(shape), start).reshape(shape)

    try:
        checksum, text_length, length = PREFIX.unpack_from(data)
        body = memoryview(data)[PREFIX.size :]
        if len(body) != text_length + length or zlib.crc32(body) != checksum:
            raise ValueError('length or checksum is wrong')
        arrays = bytearray(body[text_length:])  # makes the arrays writable
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
        raise ValueError(f'{len(data)} bytes without a value: {error}') from error


def read_value(stream: BinaryIO, kinds: Collection[type]) -> Any:
    """Return the next value, or None at the end. Raises ValueError if the bytes are invalid."""
    prefix = stream.read(PREFIX.size)
    if len(prefix) < PREFIX.size:
        return None
    body = stream.read(length := body_length(prefix))
    return unpacked(prefix + body, kinds) if len(body) == length else None


def write_value(stream: BinaryIO, value: object) -> None:
    stream.write(packed(value))
    stream.flush()


async def next_value(stream: asyncio.StreamReader, kinds: Collection[type]) -> Any:
    """Return the next value. Raises EOFError at the end, ValueError if the bytes are invalid."""
    prefix = await stream.readexactly(PREFIX.size)
    body = await stream.readexactly(body_length(prefix))
    return unpacked(prefix + body, kinds)


def _fields(value: Any) -> Any:
    """Return a dataclass as {type's name: values of its fields}, or a numpy number as a number."""
    if isinstance(value, np.generic):
        return value.item()
    try:
        return {type(value).__name__: [getattr(value, name) for name in value.__match_args__]}
    except AttributeError:
        raise TypeError(f'a {type(value).__name__} cannot be passed') from None


def _tuple(value: Any) -> Any:
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


_THREADS = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')
"""Variables with the thread counts of the numeric libraries, which are set to 1. The matrices are
small, and spinning threads would delay time-critical work."""


async def start_worker(module: str, stderr: int | None = None) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        *module_command(module),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=stderr,
        env=os.environ | dict.fromkeys(_THREADS, '1'),
        start_new_session=True,  # the parent handles Ctrl-C
    )


async def until_done(task: 'asyncio.Task[None] | asyncio.Task[int]') -> None:
    """Wait for a task that ends soon, even if the caller is cancelled. Raise its exception."""
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
    """Kill a worker, and wait until it has ended, even if the caller is cancelled."""
    with contextlib.suppress(ProcessLookupError):
        process.kill()
    await until_done(asyncio.create_task(process.wait()))


def answer_file() -> BinaryIO:
    """Return the file for a worker's replies, and redirect printed output to stderr."""
    open_closed_streams()
    answers = os.fdopen(os.dup(1), 'wb')
    os.dup2(2, 1)
    return answers


def ending(code: int | None) -> str:
    if code is not None and code < 0:
        named = -code in {number.value for number in signal.Signals}  # not for real-time signals
        return f'was ended by {signal.Signals(-code).name if named else f"signal {-code}"}'
    return f'ended with exit code {code}'
