# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Waiting for the next change of something, without polling it."""

import asyncio


class Changes:
    """`tell` wakes all that wait for the `next` one; all in one event loop."""

    def __init__(self) -> None:
        self._waiters: list[asyncio.Future[None]] = []

    async def next(self) -> None:
        """Wait for the next change."""
        waiter = asyncio.get_running_loop().create_future()
        self._waiters.append(waiter)
        await waiter

    def tell(self) -> None:
        """Something changed."""
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)
