# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smoothing of trajectories in a separate process.

Smoothing may take several seconds. A separate process can be killed at any time, and does not
block the event loop, which serves the links. Each trajectory uses a new process that has been
started in advance.
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


@dataclass(frozen=True, slots=True)
class Smoothing:
    """Settings for the smooth motion that replaces a plan. Deviations are in rad or m."""

    resample_period: float | None = None  # time between two points, s. None: the plan's points
    time_optimal: bool = False  # move as fast as the limits permit, regardless of the plan's times
    thin: bool = False  # send few points, at least `resample_period` apart
    deviation: float = np.inf  # maximum distance of the lines between them from the smooth motion
    own_points: bool = False  # only the plan's points, for a controller that ignores their times
    longest: float = np.inf  # maximum time between two points of a time-optimal motion, s
    tolerance: float = 0.0  # maximum deviation from each point of the plan

    @property
    def wanted(self) -> bool:
        return self.time_optimal or self.resample_period is not None


MIN_TOLERANCE = 1e-3
"""Minimum nonzero tolerance, rad or m. It duplicates a constant of `motion.smoothed`, because
importing that would load the smoother."""


def check_tolerance(smoothing: Smoothing) -> None:
    used = smoothing.wanted and not smoothing.own_points
    if smoothing.tolerance and not (used and smoothing.tolerance >= MIN_TOLERANCE):
        raise ValueError(
            f'{smoothing.tolerance:g} rad: must be 0, or {MIN_TOLERANCE:g} or more with '
            'smoothing = resample or thin, or timing = time_optimal'
        )


ON_SPLINE = '; it followed the spline, because no faster motion was found'

TIMEOUT_S = 30.0  # maximum time for smoothing one trajectory, s

WORKER = 'epson_driver.driver.smoothing_worker'


class SmoothingError(RuntimeError):
    """Raised if a trajectory could not be smoothed. The text contains the reason."""


class SmoothingProcess:
    def __init__(self, limits: JointLimits, smoothing: Smoothing) -> None:
        self._limits = limits
        self._smoothing = smoothing
        self._lock = asyncio.Lock()
        self._next: asyncio.Task[asyncio.subprocess.Process] | None = None
        self._current: asyncio.subprocess.Process | None = None
        self._closed = False

    def make_ready(self) -> None:
        if self._next is None and not self._closed:
            self._next = asyncio.create_task(start_worker(WORKER))

    async def prepared(
        self,
        trajectory: Trajectory,
        start: Array,
        share: tuple[float, float] = (1.0, 1.0),
        smoothing: Smoothing | None = None,
    ) -> tuple[Trajectory, str]:
        """Return the smooth motion for a checked trajectory of an arm at rest at `start`.

        The text is a remark for the result of the goal, or empty.

        `share`: maximum velocity and acceleration, as fractions of the limits. `smoothing`: other
        settings than usual.
        """
        async with self._lock:
            self._current = process = await self._next_process()
            try:
                if self._closed:
                    raise SmoothingError('the driver has ended')
                limits = self._limits.scaled(*share)
                arguments = (trajectory, start, limits, smoothing or self._smoothing)
                result = await result_of(process, arguments, (Trajectory,), TIMEOUT_S)
                if not isinstance(result, tuple):
                    raise SmoothingError(str(result))
                return result
            finally:
                self._current = None
                await end_worker(process)

    async def _next_process(self) -> asyncio.subprocess.Process:
        self.make_ready()
        starting = self._next
        if starting is None:
            raise SmoothingError('the driver has ended')
        try:
            process = await asyncio.shield(starting)  # if cancelled, it stays for the next goal
        except OSError as error:
            self._next = None
            raise SmoothingError(f'the smoother could not be started: {error}') from error
        self._next = None
        return process

    async def close(self) -> None:
        """End the processes. A pending call of `prepared` raises SmoothingError."""
        self._closed = True
        if self._current is not None and self._current.returncode is None:
            self._current.kill()
        async with self._lock:
            starting, self._next = self._next, None
            if starting is not None:
                await until_done(asyncio.create_task(_end_started(starting)))


async def result_of(
    process: asyncio.subprocess.Process, value: object, kinds: Collection[type], timeout: float
) -> object:
    """Send `value` to a worker process and return its result. `kinds`: allowed result types."""
    if process.stdin is None or process.stdout is None:
        raise ValueError('the worker process was started without pipes for stdin and stdout')
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
