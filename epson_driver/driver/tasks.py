# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The tasks of a driver's event loop, and what they wait for: a change, or a fresh state."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from typing import Any

from epson_driver.link.receive_timeout import READING_TURNS


class TaskEndedError(RuntimeError):
    """A task ended that should run on, as its text says."""


def report_error(what: str, error: BaseException) -> None:
    """Tell the running loop's exception handler that something failed."""
    loop = asyncio.get_running_loop()
    loop.call_exception_handler({'message': what, 'exception': error})


def report_task_error(task: 'asyncio.Task[Any]') -> None:
    """Report what a task raised: `task.add_done_callback(report_task_error)`.

    Without it asyncio says so when the task is thrown away, if ever.
    """
    if not task.cancelled() and (error := task.exception()) is not None:
        report_error(f'{task.get_coro().__qualname__} failed', error)  # type: ignore[union-attr]


TaskFunction = Callable[[], Coroutine[Any, Any, None]]


async def run_task_group(
    parts: Mapping[str, TaskFunction], stop: Callable[[], Awaitable[None]]
) -> None:
    """Run parts, by their names, until all have returned, one fails, or this is cancelled.

    When one fails, or is cancelled by anything but this, the loop's exception handler is told,
    `stop` is awaited while the others still run, and the error is raised. No part outlives this.
    """
    ending = False
    group = asyncio.current_task()

    async def run(name: str, part: TaskFunction) -> None:
        try:
            await part()
        except asyncio.CancelledError as error:
            if ending or (group is not None and group.cancelling()):  # the loop ends all of them
                raise
            raise TaskEndedError(f'{name} was cancelled') from error

    tasks = {asyncio.create_task(run(name, part)): name for name, part in parts.items()}
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)
        for task, name in tasks.items():
            if task.done() and (error := task.exception()) is not None:
                report_error(f'{name} failed', error)
                await stop()
                raise error
    finally:
        ending = True
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


class Notification:
    """Wakes all tasks that wait when it is notified, as asyncio.Condition, for one event loop."""

    def __init__(self) -> None:
        self._waiters: list[asyncio.Future[None]] = []

    @property
    def waiting(self) -> int:
        """How many tasks wait."""
        return len(self._waiters)

    async def wait(self) -> None:
        """Wait for the next `notify_all`."""
        waiter = asyncio.get_running_loop().create_future()
        self._waiters.append(waiter)
        await waiter

    def notify_all(self) -> None:
        """Wake every task that waits."""
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)


MAX_READING_TURNS = 100
"""Turns of the event loop that are given to reading in the end: 5000 state messages, which take
25 s to come. If there is nothing to read, they take about a millisecond."""


async def wait_for_fresh_state(
    stale: Callable[[float], object], heard: Notification, patience: float
) -> float:
    """Wait for a fresh state, and return the loop's time at which to judge it, s.

    The first at which `stale` does not hold, after `patience` s otherwise the last. `heard` is
    notified when something came.

    A pose is old if nothing newer has come, not if this process was held up before it could look:
    its age is counted to a moment by which everything that had come was read for certain.
    """
    loop = asyncio.get_running_loop()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(patience):
            while True:
                moment = loop.time()
                if await _read_by(moment, stale, READING_TURNS):
                    return moment
                await heard.wait()
    moment = loop.time()
    await _read_by(moment, stale, MAX_READING_TURNS)
    return moment


async def _read_by(moment: float, stale: Callable[[float], object], turns: int) -> bool:
    """Let pending input be read, and return whether the state is fresh at a moment."""
    for _ in range(turns):
        if not stale(moment):
            return True
        await asyncio.sleep(0)
    return not stale(moment)
