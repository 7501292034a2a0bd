# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Prepares trajectories in a process of its own, since it takes up to seconds of computing.

Each trajectory has a fresh process, which waits ready-made: it can be killed at any moment, and
the event loop, on which the links live, only waits for it.
"""

import asyncio
import contextlib
import os
import pickle
import signal
import sys

from epson_driver.driver.smoothing.smoothing import Smoothing
from epson_driver.driver.tasks.task_group import until_done
from epson_driver.motion import Array, JointLimits, Trajectory

TIMEOUT_S = 30.0
"""How long the preparation of one trajectory may take, s: longer than any plan should."""

_THREADS = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')
"""Thread counts of the numeric libraries; each is set to 1: the matrices are small."""


class SmoothingError(RuntimeError):
    """A trajectory could not be prepared; the text says why."""


class SmoothingProcess:
    """Prepares trajectories, one at a time. Lives in the event loop."""

    def __init__(self, limits: JointLimits, smoothing: Smoothing) -> None:
        self._limits = limits
        self._smoothing = smoothing
        self._next: asyncio.Task[asyncio.subprocess.Process] | None = None
        self._closed = False

    def make_ready(self) -> None:
        """Start the next process, so that the next trajectory need not wait; not once closed."""
        if self._next is None and not self._closed:
            self._next = asyncio.create_task(start_process())

    async def prepared(self, trajectory: Trajectory, start: Array) -> Trajectory:
        """Return what to send for a checked trajectory of an arm that rests at `start`.

        Raises SmoothingError. When cancelled, the process ends at once.
        """
        arguments = pickle.dumps((trajectory, start, self._limits, self._smoothing))
        process = await self._take()
        try:
            async with asyncio.timeout(TIMEOUT_S):
                answer, _ = await process.communicate(arguments)
        except TimeoutError as error:
            raise SmoothingError(f'no smooth motion was found within {TIMEOUT_S:g} s') from error
        finally:
            await _end(process)
        if process.returncode or not answer:
            raise SmoothingError(f'the smoother {_fate(process.returncode)}')
        try:
            result = pickle.loads(answer)  # noqa: S301 - our own child's
        except Exception as error:  # pickle raises what it likes
            raise SmoothingError(f'the answer of the smoother is no pickle: {error}') from error
        if not isinstance(result, Trajectory):
            raise SmoothingError(str(result))
        return result

    async def _take(self) -> asyncio.subprocess.Process:
        """Return the process that was started for the next trajectory."""
        self.make_ready()
        waiting = self._next
        assert waiting is not None  # noqa: S101 - for the type checker
        try:
            process = await asyncio.shield(waiting)  # when cancelled, it waits for the next goal
        except OSError as error:
            self._next = None
            raise SmoothingError(f'the smoother could not be started: {error}') from error
        self._next = None
        return process

    async def close(self) -> None:
        """End the process that was started for the next trajectory; no other is started."""
        self._closed = True
        waiting, self._next = self._next, None
        if waiting is not None:
            await until_done(asyncio.create_task(_end_started(waiting)))


async def start_process() -> asyncio.subprocess.Process:
    """Return a process that waits for its arguments."""
    # the child finds the package where this process found it, sourced workspace or not
    path = os.pathsep.join(filter(None, sys.path))
    return await asyncio.create_subprocess_exec(
        sys.executable,
        '-m',
        'epson_driver.driver.smoothing.smoothing_worker',
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        env=os.environ | dict.fromkeys(_THREADS, '1') | {'PYTHONPATH': path},
        start_new_session=True,  # Ctrl-C is the driver's to handle
    )


async def _end_started(starting: asyncio.Task[asyncio.subprocess.Process]) -> None:
    with contextlib.suppress(OSError):
        await _end(await starting)


async def _end(process: asyncio.subprocess.Process) -> None:
    if process.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await until_done(asyncio.create_task(process.wait()))


def _fate(code: int | None) -> str:
    if code is not None and code < 0:
        named = -code in {number.value for number in signal.Signals}  # not those of real time
        return f'was ended by {signal.Signals(-code).name if named else f"signal {-code}"}'
    return f'ended with exit code {code}'
