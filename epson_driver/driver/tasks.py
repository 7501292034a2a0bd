# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Task groups, change notifications, and waiting for a fresh state, in the event loop."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from typing import Any

from epson_driver.link.connection import READING_TURNS


class TaskEndedError(RuntimeError):
    """Raised if a task was cancelled unexpectedly. The text names the task."""


def report_error(what: str, error: BaseException) -> None:
    loop = asyncio.get_running_loop()
    loop.call_exception_handler({'message': what, 'exception': error})


def report_task_error(task: 'asyncio.Task[Any]') -> None:
    """Report the exception of a task, because asyncio would report it late or never."""
    if not task.cancelled() and (error := task.exception()) is not None:
        report_error(f'{task.get_coro().__qualname__} failed', error)  # type: ignore[union-attr]


TaskFunction = Callable[[], Coroutine[Any, Any, None]]


async def run_task_group(
    parts: Mapping[str, TaskFunction], stop: Callable[[], Awaitable[None]]
) -> None:
    """Run named parts until all have returned, one fails, or the caller is cancelled.

    A part fails if it raises, or if it alone is cancelled. Its error is then reported to the
    loop's exception handler, `stop` is awaited while the other parts still run, and the error is
    raised. All parts have ended when the function returns.
    """
    ending = False
    group = asyncio.current_task()

    async def run(name: str, part: TaskFunction) -> None:
        try:
            await part()
        except asyncio.CancelledError as error:
            if ending or (group is not None and group.cancelling()):  # all of them are cancelled
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
    """Wakes all waiting tasks, like asyncio.Condition, but without a lock."""

    def __init__(self) -> None:
        self._waiters: list[asyncio.Future[None]] = []

    @property
    def waiting(self) -> int:
        return len(self._waiters)

    async def wait(self) -> None:
        waiter = asyncio.get_running_loop().create_future()
        self._waiters.append(waiter)
        await waiter

    def notify_all(self) -> None:
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)


MAX_READING_TURNS = 100
"""Maximum number of turns of the event loop for reading pending input. In 100 turns the loop reads
5000 state messages, which arrive in 25 s. Without input, the turns take about 1 ms."""


async def wait_for_fresh_state(
    stale: Callable[[float], object], changed: Notification, timeout: float
) -> float:
    """Wait up to `timeout` s for a fresh state. Return the loop time at which it was checked, s.

    `stale(time)` returns whether the state is too old at a time. `changed` is notified when input
    has arrived. All input that had arrived by the returned time has been read, so no state counts
    as stale while a newer state is unread.
    """
    loop = asyncio.get_running_loop()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(timeout):
            while True:
                now = loop.time()
                if await _is_fresh(now, stale, READING_TURNS):
                    return now
                await changed.wait()
    now = loop.time()
    await _is_fresh(now, stale, MAX_READING_TURNS)
    return now


async def _is_fresh(now: float, stale: Callable[[float], object], turns: int) -> bool:
    """Return whether the state is fresh at `now`, after reading input for up to `turns` turns."""
    for _ in range(turns):
        if not stale(now):
            return True
        await asyncio.sleep(0)
    return not stale(now)
