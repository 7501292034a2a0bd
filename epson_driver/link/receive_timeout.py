# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Measures the silence of a peer, excluding time when this process did not run.

A process that was not scheduled for a second has not observed its peer silent for a second,
because messages may wait in the socket. Therefore the timeout is divided into slices. A slice
counts once, regardless of its duration, and pending data is read before the slice counts. Without
delays of the process, the total is exactly the timeout.
"""

import asyncio

SLICES = 8
"""Number of slices. A delay of this process adds at most one slice to the measured silence."""

READING_TURNS = 2
"""Turns of the event loop after a timer that read all pending socket data. The first turn polls
the selector, the second runs the callbacks of that poll after those already queued."""


class ReceiveTimeout:
    """Receive timeout that ignores time when this process was not scheduled.

    `patience`: the timeout, s; `now`: the loop's time, s.

    Call `heard` at the start and on each received message, and `passed` at the end of each slice.
    """

    def __init__(self, patience: float) -> None:
        self.patience = patience
        self.slice = patience / SLICES
        self._quiet = 0
        self._began = 0.0

    def heard(self, now: float) -> None:
        """Restart the timeout after a message."""
        self._quiet, self._began = 0, now

    def left(self, now: float) -> float:
        """Return the time left in the current slice, s (≤ 0 when expired)."""
        return self._began + self.slice - now

    def passed(self, now: float) -> bool:
        """Count an expired slice. Returns whether the whole timeout has passed in silence."""
        self._quiet += 1
        self._began = now
        return self._quiet >= SLICES


async def silent(silence: ReceiveTimeout) -> None:
    """Wait until nothing has been received for the whole timeout, starting now."""
    now = asyncio.get_running_loop().time
    silence.heard(now())
    turns = READING_TURNS
    while True:
        if (left := silence.left(now())) > 0.0:
            turns = READING_TURNS
            await asyncio.sleep(left)
        elif turns:
            turns -= 1
            await asyncio.sleep(0)
        elif silence.passed(now()):
            return
