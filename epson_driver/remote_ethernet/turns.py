# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Who talks to a controller's remote port: it serves one client at a time. Motors go first."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any, TypeVar

T = TypeVar('T')


class GaveWayError(ConnectionError):
    """Something more urgent needed the remote port before all was done."""

    def __init__(self) -> None:
        super().__init__('the remote port was needed for the motors')


class RemoteTurns:
    """Lets one dialogue at a time have the port. For one event loop."""

    def __init__(self) -> None:
        self._lock = asyncio.Lock()
        self._urgent = 0
        self._patient: asyncio.Task[Any] | None = None

    @asynccontextmanager
    async def urgent(self) -> AsyncIterator[None]:
        """Have the port at once, breaking off a patient dialogue but no urgent one."""
        self._urgent += 1
        try:
            if self._patient is not None:
                self._patient.cancel()
            async with self._lock:
                yield
        finally:
            self._urgent -= 1

    async def patient(self, dialogue: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Return what a dialogue returns, when it is its turn.

        Raises what it raises, and GaveWayError if the port is needed, before or meanwhile.
        """
        async with self._lock:
            if self._urgent:
                raise GaveWayError
            task = asyncio.create_task(dialogue())
            self._patient = task
            try:
                await asyncio.wait([task])
            finally:
                self._patient = None
                task.cancel()  # nothing, unless who waits was cancelled
                await asyncio.gather(task, return_exceptions=True)
            if task.cancelled():
                raise GaveWayError
            return task.result()
