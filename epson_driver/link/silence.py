# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How long nothing has come, as far as this process was there to see it.

A process that is not scheduled for a second has not seen its peer silent for a second: what came
meanwhile waits in the socket. So the time is cut into slices, and however long a slice took, it
counts once; and what waits at the end of a slice is read before the slice counts at all.
"""

import asyncio

SLICES = 8
"""A delay of this process adds at most this part of the patience to the silence."""

READING_TURNS = 2
"""Turns of the event loop after a timer, by which what waited in a socket has been read: in the
first the selector is asked, and what it finds has its turn after what was in line before it."""


class Silence:
    """Counts slices in which nothing came. `patience`: s.

    `heard` whenever something comes, `passed` at the end of each slice of `slice` s.
    """

    def __init__(self, patience: float) -> None:
        self.patience = patience
        self.slice = patience / SLICES
        self._quiet = 0

    @property
    def broken(self) -> bool:
        """Whether something came in this slice."""
        return self._quiet < 0

    def heard(self) -> None:
        """Begin to count anew, as something was received."""
        self._quiet = -1  # of the slice that it came in, nobody knows how much was quiet

    def restart(self) -> None:
        """Begin to wait again, as if the slice before were the last one with something in it."""
        self._quiet = 0

    def passed(self) -> bool:
        """Count a slice; return whether nothing came for all of the patience."""
        self._quiet += 1
        return self._quiet >= SLICES


async def passed(silence: Silence) -> bool:
    """Sleep for a slice, and count it when what came meanwhile has been read.

    Returns whether nothing came for all of the patience.
    """
    await asyncio.sleep(silence.slice)
    for _ in range(READING_TURNS):
        if silence.broken:
            break
        await asyncio.sleep(0)
    return silence.passed()
