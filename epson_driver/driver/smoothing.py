# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smooth motion through a plan, computed in a separate process for up to several seconds.

Each trajectory uses a new process, which is started in advance. It can be killed at any time, and
the event loop, which serves the links, is never blocked.
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
    """Settings for the motion that replaces a plan.

    resample_period: time between two points of the smooth motion, s; None: the plan's points.
    time_optimal: as fast as the limits allow, regardless of the plan's times. thin: few points, at
    least resample_period apart, at points of the plan where possible. Straight lines between them
    deviate from the smooth motion by at most `deviation` rad (or m) in any joint. longest: maximum
    time between two points of a time-optimal plan, s. tolerance: maximum deviation of the motion
    from each point of the plan, rad or m, in each joint; 0: it passes through them.
    """

    resample_period: float | None = None
    time_optimal: bool = False
    thin: bool = False
    deviation: float = np.inf
    longest: float = np.inf
    tolerance: float = 0.0

    @property
    def wanted(self) -> bool:
        """Whether a plan is changed before it is sent."""
        return self.time_optimal or self.resample_period is not None


def usual_smoothing(program: ProgramProfile) -> Smoothing:
    """Return a controller's default smoothing."""
    return Smoothing(
        None if program.smoothing == 'none' else program.resample_period,
        thin=program.smoothing == 'thin',
        deviation=program.thin_deviation,
    )


MIN_TOLERANCE = 1e-3
"""Minimum nonzero tolerance, rad or m. It repeats the constant of `motion.smoothed`,
to avoid loading the smoother."""


def check_tolerance(smoothing: Smoothing) -> None:
    """Raise ValueError if the tolerance is neither 0 nor possible with the other settings."""
    keeps_times = smoothing.resample_period is not None and not smoothing.time_optimal
    if smoothing.tolerance and not (keeps_times and smoothing.tolerance >= MIN_TOLERANCE):
        raise ValueError(
            f'{smoothing.tolerance:g} rad: must be 0, or {MIN_TOLERANCE:g} or more with '
            'smoothing = resample or thin, and timing = as_planned'
        )


TIMEOUT_S = 30.0
"""Time limit for preparing one trajectory, s: longer than any plan should take."""

WORKER = 'epson_driver.driver.smoothing_worker'


class SmoothingError(RuntimeError):
    """A trajectory could not be prepared. The text contains the reason."""


class SmoothingProcess:
    """Prepares trajectories, one at a time. Runs in the event loop."""

    def __init__(self, limits: JointLimits, smoothing: Smoothing) -> None:
        self._limits = limits
        self._smoothing = smoothing
        self._one = asyncio.Lock()
        self._next: asyncio.Task[asyncio.subprocess.Process] | None = None
        self._closed = False

    def make_ready(self) -> None:
        """Start the next process, unless closed, so that the next trajectory does not wait."""
        if self._next is None and not self._closed:
            self._next = asyncio.create_task(start_worker(WORKER))

    async def prepared(self, trajectory: Trajectory, start: Array) -> Trajectory:
        """Return the smooth motion for a checked trajectory of an arm at rest at `start`.

        Raises SmoothingError if none is found. Cancelling ends the process immediately.
        """
        async with self._one:
            process = await self._take()
            try:
                arguments = (trajectory, start, self._limits, self._smoothing)
                result = await answered(process, arguments, (Trajectory,), TIMEOUT_S)
                if not isinstance(result, Trajectory):
                    raise SmoothingError(str(result))
                return result
            finally:
                await end_worker(process)

    async def _take(self) -> asyncio.subprocess.Process:
        """Return the process that was started for the next trajectory."""
        self.make_ready()
        waiting = self._next
        assert waiting is not None  # noqa: S101 - for the type checker
        try:
            process = await asyncio.shield(waiting)  # if cancelled, it stays for the next goal
        except OSError as error:
            self._next = None
            raise SmoothingError(f'the smoother could not be started: {error}') from error
        self._next = None
        return process

    async def close(self) -> None:
        """End all processes and start no other. Calls of `prepared` must have been cancelled."""
        self._closed = True
        async with self._one:
            waiting, self._next = self._next, None
            if waiting is not None:
                await until_done(asyncio.create_task(_end_started(waiting)))


async def answered(
    process: asyncio.subprocess.Process, value: object, kinds: Collection[type], timeout: float
) -> object:
    """Return a worker's answer. Raises SmoothingError if it fails or exceeds `timeout` s."""
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
