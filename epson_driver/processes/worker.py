# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A child process that computes: values come to its stdin, and answers from its stdout."""

import asyncio
import contextlib
import os
import signal
from typing import BinaryIO

from epson_driver.processes.command import module_command
from epson_driver.processes.standard_streams import open_closed_streams

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
    """Return where a worker's answers go, and send whatever prints to stderr."""
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
