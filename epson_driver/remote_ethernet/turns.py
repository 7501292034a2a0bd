# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Serializes dialogues on a controller's remote port, which serves one client. Motors go first."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any, TypeVar

T = TypeVar('T')


class GaveWayError(ConnectionError):
    """A more urgent dialogue needed the remote port."""

    def __init__(self) -> None:
        super().__init__('the remote port was needed for the motors')


class RemoteTurns:
    """Allows one dialogue at a time on the port. For one event loop."""

    def __init__(self) -> None:
        self._lock = asyncio.Lock()
        self._urgent = 0
        self._patient: asyncio.Task[Any] | None = None

    @asynccontextmanager
    async def urgent(self) -> AsyncIterator[None]:
        """Acquire the port. A patient dialogue is cancelled, an urgent one is awaited."""
        self._urgent += 1
        try:
            if self._patient is not None:
                self._patient.cancel()
            async with self._lock:
                yield
        finally:
            self._urgent -= 1

    async def patient(self, dialogue: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Wait for the port, run a dialogue, and return its result.

        Raises the dialogue's exceptions, and GaveWayError if an urgent dialogue needs the port.
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
                task.cancel()  # has an effect only if the waiting caller was cancelled
                await asyncio.gather(task, return_exceptions=True)
            if task.cancelled():
                raise GaveWayError
            return task.result()
