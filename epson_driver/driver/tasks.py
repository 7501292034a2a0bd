# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The tasks of a driver's event loop, change notifications, and waiting for a fresh state."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from typing import Any

from epson_driver.link.connection import READING_TURNS


class TaskEndedError(RuntimeError):
    """A task ended unexpectedly. The text names the task."""


def report_error(what: str, error: BaseException) -> None:
    """Report an error to the exception handler of the running loop."""
    loop = asyncio.get_running_loop()
    loop.call_exception_handler({'message': what, 'exception': error})


def report_task_error(task: 'asyncio.Task[Any]') -> None:
    """Report the exception of a task: `task.add_done_callback(report_task_error)`.

    Otherwise asyncio only reports it when the task is garbage-collected, if at all.
    """
    if not task.cancelled() and (error := task.exception()) is not None:
        report_error(f'{task.get_coro().__qualname__} failed', error)  # type: ignore[union-attr]


TaskFunction = Callable[[], Coroutine[Any, Any, None]]


async def run_task_group(
    parts: Mapping[str, TaskFunction], stop: Callable[[], Awaitable[None]]
) -> None:
    """Run named parts until all have returned, one fails, or this is cancelled.

    If a part fails, or is cancelled separately, the error is reported to the loop's exception
    handler, `stop` is awaited while the other parts still run, and the error is raised. All parts
    have ended when this returns.
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
    """Wakes all waiting tasks, like asyncio.Condition, for one event loop."""

    def __init__(self) -> None:
        self._waiters: list[asyncio.Future[None]] = []

    @property
    def waiting(self) -> int:
        """Number of waiting tasks."""
        return len(self._waiters)

    async def wait(self) -> None:
        """Wait for the next `notify_all`."""
        waiter = asyncio.get_running_loop().create_future()
        self._waiters.append(waiter)
        await waiter

    def notify_all(self) -> None:
        """Wake all waiting tasks."""
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)


MAX_READING_TURNS = 100
"""Maximum turns of the event loop for reading pending input: enough for 5000 state messages, which
take 25 s to arrive. If there is no input, they take about a millisecond."""


async def wait_for_fresh_state(
    stale: Callable[[float], object], heard: Notification, patience: float
) -> float:
    """Wait for a fresh state, and return the loop's time at which to judge it, s.

    This is the first time at which `stale` is false, or the last one after `patience` s. `heard`
    is notified when input has arrived.

    A pose is old if no newer one has arrived, not if this process was delayed before reading it.
    Its age therefore counts to a time by which all input that had arrived has certainly been read.
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
    """Give pending input time to be read, and return whether the state is fresh at a moment."""
    for _ in range(turns):
        if not stale(moment):
            return True
        await asyncio.sleep(0)
    return not stale(moment)
