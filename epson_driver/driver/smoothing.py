# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smoothing of trajectories in a separate process.

Smoothing may take several seconds. A process can be killed at any time and does not block the
event loop, which serves the links. Each trajectory uses a new process, started in advance.
"""

import asyncio
import contextlib
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.processes.worker import (
    end_worker,
    ending,
    next_value,
    packed,
    start_worker,
    until_done,
)
from epson_driver.profiles.profile import ProgramProfile


@dataclass(frozen=True, slots=True)
class Smoothing:
    """Settings for the smooth motion that replaces a plan.

    * `resample_period`: time between two points of the smooth motion, s; None: the plan's points.
    * `time_optimal`: move as fast as the limits permit, regardless of the plan's times.
    * `thin`: send few points, at least `resample_period` apart.
    * `deviation`: maximum deviation of the straight lines between these points from the smooth
      motion, in each joint, rad or m.
    * `longest`: maximum time between two points of a time-optimal motion, s.
    * `tolerance`: maximum deviation of the motion from each point of the plan, in each joint,
      rad or m.
    """

    resample_period: float | None = None
    time_optimal: bool = False
    thin: bool = False
    deviation: float = np.inf
    longest: float = np.inf
    tolerance: float = 0.0

    @property
    def wanted(self) -> bool:
        """Whether plans are changed before they are sent."""
        return self.time_optimal or self.resample_period is not None


def usual_smoothing(program: ProgramProfile) -> Smoothing:
    """Return a controller's default smoothing."""
    return Smoothing(
        None if program.smoothing == 'none' else program.resample_period,
        thin=program.smoothing == 'thin',
        deviation=program.thin_deviation,
    )


MIN_TOLERANCE = 1e-3
"""Minimum nonzero tolerance, rad or m. Duplicates a constant of `motion.smoothed`, because an
import would load the smoother."""


def check_tolerance(smoothing: Smoothing) -> None:
    """Raise ValueError if the tolerance is too small or incompatible with the other settings."""
    keeps_times = smoothing.resample_period is not None and not smoothing.time_optimal
    if smoothing.tolerance and not (keeps_times and smoothing.tolerance >= MIN_TOLERANCE):
        raise ValueError(
            f'{smoothing.tolerance:g} rad: must be 0, or {MIN_TOLERANCE:g} or more with '
            'smoothing = resample or thin, and timing = as_planned'
        )


TIMEOUT_S = 30.0
"""Maximum time for smoothing one trajectory, s."""

WORKER = 'epson_driver.driver.smoothing_worker'


class SmoothingError(RuntimeError):
    """Raised if a trajectory could not be smoothed. The text contains the reason."""


class SmoothingProcess:
    """Smooths trajectories in separate processes, one at a time."""

    def __init__(self, limits: JointLimits, smoothing: Smoothing) -> None:
        self._limits = limits
        self._smoothing = smoothing
        self._lock = asyncio.Lock()
        self._next: asyncio.Task[asyncio.subprocess.Process] | None = None
        self._closed = False

    def make_ready(self) -> None:
        """Start the process for the next trajectory in advance."""
        if self._next is None and not self._closed:
            self._next = asyncio.create_task(start_worker(WORKER))

    async def prepared(self, trajectory: Trajectory, start: Array) -> Trajectory:
        """Return the smooth motion for a checked trajectory of an arm at rest at `start`.

        `start`: shape (n,), rad. Raises SmoothingError if no motion within the limits is found.
        Cancelling ends the process immediately.
        """
        async with self._lock:
            process = await self._next_process()
            try:
                arguments = (trajectory, start, self._limits, self._smoothing)
                result = await result_of(process, arguments, (Trajectory,), TIMEOUT_S)
                if not isinstance(result, Trajectory):
                    raise SmoothingError(str(result))
                return result
            finally:
                await end_worker(process)

    async def _next_process(self) -> asyncio.subprocess.Process:
        self.make_ready()
        starting = self._next
        assert starting is not None  # noqa: S101 - for the type checker
        try:
            process = await asyncio.shield(starting)  # if cancelled, it stays for the next goal
        except OSError as error:
            self._next = None
            raise SmoothingError(f'the smoother could not be started: {error}') from error
        self._next = None
        return process

    async def close(self) -> None:
        """End the process started in advance, if any. Cancel calls of `prepared` before this."""
        self._closed = True
        async with self._lock:
            starting, self._next = self._next, None
            if starting is not None:
                await until_done(asyncio.create_task(_end_started(starting)))


async def result_of(
    process: asyncio.subprocess.Process, value: object, kinds: Collection[type], timeout: float
) -> object:
    """Send `value` to a worker process, and return its result, which is of one of `kinds`.

    Raises SmoothingError if the process fails or takes longer than `timeout` s.
    """
    if process.stdin is None or process.stdout is None:
        raise ValueError('a process with pipes is needed')
    try:
        async with asyncio.timeout(timeout):
            process.stdin.write(packed(value))
            try:
                return await next_value(process.stdout, kinds)
            except (OSError, EOFError):
                raise SmoothingError(f'the smoother {ending(await process.wait())}') from None
    except TimeoutError as error:
        raise SmoothingError(f'no smooth motion was found within {timeout:g} s') from error
    except ValueError as error:
        raise SmoothingError(f'the smoother sent {error}') from error


async def _end_started(starting: asyncio.Task[asyncio.subprocess.Process]) -> None:
    with contextlib.suppress(OSError):
        await end_worker(await starting)
