# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Waiting for the next change of something, without polling it.

As asyncio.Condition without its lock: everything runs in one event loop.
"""

import asyncio


class Notification:
    """Wakes all tasks that wait when it is notified. Use it from one event loop only."""

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
