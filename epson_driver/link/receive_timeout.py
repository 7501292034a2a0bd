# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How long nothing has come, as far as this process was there to see it.

A process that is not scheduled for a second has not seen its peer silent for a second: what came
meanwhile waits in the socket. So the time since something came is cut into slices, and however
long a slice took, it counts once; and what waits at the end of a slice is read before the slice
counts at all. In a process that is not held up they are the patience, exactly.
"""

import asyncio

SLICES = 8
"""A delay of this process adds at most this part of the patience to the silence."""

READING_TURNS = 2
"""Turns of the event loop after a timer, by which what waited in a socket has been read: in the
first the selector is asked, and what it finds has its turn after what was in line before it."""


class ReceiveTimeout:
    """Receive timeout that ignores time when this process was not scheduled.

    `patience`: s; `now`: the loop's time, s.

    `heard` when it begins and whenever something comes, `passed` at the end of each slice.
    """

    def __init__(self, patience: float) -> None:
        self.patience = patience
        self.slice = patience / SLICES
        self._quiet = 0
        self._began = 0.0

    def heard(self, now: float) -> None:
        """Begin to count anew, as something was received."""
        self._quiet, self._began = 0, now

    def left(self, now: float) -> float:
        """Return how long the slice goes on, s, which is 0 or less once it is over."""
        return self._began + self.slice - now

    def passed(self, now: float) -> bool:
        """Count a slice that is over, and return whether the whole timeout passed in silence."""
        self._quiet += 1
        self._began = now
        return self._quiet >= SLICES


async def silent(silence: ReceiveTimeout) -> None:
    """Wait until nothing has come for all of the patience, from now on."""
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
