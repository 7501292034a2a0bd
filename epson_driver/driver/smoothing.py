# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smooth motion through a plan, computed for up to seconds in a process of its own.

Each trajectory has a fresh process, which waits ready-made: it can be killed at any moment, and
the event loop, on which the links live, only waits for it.
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
    """Which motion is sent instead of a plan.

    resample_period: time between two points of the smooth motion, s; None for the plan's own
    points. time_optimal: as fast as the limits allow, whatever the plan's times. thin: few points,
    resample_period apart or more, of the plan's own where they are; straight ways between them are
    at most deviation rad (or m) off the smooth motion, in any joint. longest: time between two
    points of a time-optimal plan at most, s. tolerance: how far beside each point of the plan the
    motion may pass, rad or m, in each joint; 0: it goes through them.
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
"""The least tolerance but 0, rad or m, as `motion.evened` has it: the smoother is not loaded."""


def check_tolerance(smoothing: Smoothing) -> None:
    """Raise ValueError unless there is no tolerance, or one that can be kept to."""
    keeps_times = smoothing.resample_period is not None and not smoothing.time_optimal
    if smoothing.tolerance and not (keeps_times and smoothing.tolerance >= MIN_TOLERANCE):
        raise ValueError(
            f'{smoothing.tolerance:g} rad: must be 0, or {MIN_TOLERANCE:g} or more with '
            'smoothing = resample or thin, and timing = as_planned'
        )


TIMEOUT_S = 30.0
"""How long the preparation of one trajectory may take, s: longer than any plan should."""

WORKER = 'epson_driver.driver.smoothing_worker'


class SmoothingError(RuntimeError):
    """A trajectory could not be prepared, with the reason as its text."""


class SmoothingProcess:
    """Prepares trajectories, one at a time. Lives in the event loop."""

    def __init__(self, limits: JointLimits, smoothing: Smoothing) -> None:
        self._limits = limits
        self._smoothing = smoothing
        self._next: asyncio.Task[asyncio.subprocess.Process] | None = None
        self._closed = False

    def make_ready(self) -> None:
        """Start the next process, unless closed, so that the next trajectory need not wait."""
        if self._next is None and not self._closed:
            self._next = asyncio.create_task(start_worker(WORKER))

    async def prepared(self, trajectory: Trajectory, start: Array) -> Trajectory:
        """Return the smooth motion for a checked trajectory of an arm that rests at `start`.

        Raises SmoothingError. When cancelled, the process ends at once.
        """
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
            process = await asyncio.shield(waiting)  # when cancelled, it waits for the next goal
        except OSError as error:
            self._next = None
            raise SmoothingError(f'the smoother could not be started: {error}') from error
        self._next = None
        return process

    async def close(self) -> None:
        """End the process that was started for the next trajectory, and start no other."""
        self._closed = True
        waiting, self._next = self._next, None
        if waiting is not None:
            await until_done(asyncio.create_task(_end_started(waiting)))


async def answered(
    process: asyncio.subprocess.Process, value: object, kinds: Collection[type], timeout: float
) -> object:
    """Return a worker's answer. Raises SmoothingError, also after `timeout` s."""
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
