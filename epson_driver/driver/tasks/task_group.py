# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The parts of a driver that run side by side in its event loop: the end of one is not kept quiet.

A failure is reported to the loop's exception handler (`loop.set_exception_handler`) at once. The
client's process has one that stops all its arms and ends it (node/client_process.py).
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from typing import Any


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

    When one fails, or is cancelled by anything but this, that is reported, `stop` is awaited while
    the others still run, and the error is raised. No part outlives this.
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
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)
        for task in done:
            if (error := task.exception()) is not None:
                report_error(f'{tasks[task]} failed', error)
                await stop()
                raise error
    finally:
        ending = True
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
