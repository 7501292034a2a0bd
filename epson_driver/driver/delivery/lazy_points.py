# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Messages of a trajectory that are made when they are about to be sent.

However many there are, the first one is there at once, made alone, and only some are in memory.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar, overload

from epson_driver.simple_message import Message

BLOCK_POINTS = 256
"""So many are made at a time, in half a millisecond: numpy takes as long for a few. But the first
one is made alone, as the arm waits for it."""

M = TypeVar('M', bound=Message)


class LazyPoints(Sequence[M]):
    """`count` messages; `make(first, end)` returns those of points `first` to `end` - 1."""

    def __init__(self, count: int, make: Callable[[int, int], Sequence[M]]) -> None:
        self._count = count
        self._make = make
        self._first = 0
        self._made: Sequence[M] = ()

    def __len__(self) -> int:
        """How many there are."""
        return self._count

    @overload
    def __getitem__(self, index: int) -> M: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[M]: ...

    def __getitem__(self, index: int | slice) -> M | Sequence[M]:
        """Return one of them, or some, which are then all made."""
        if isinstance(index, slice):
            return [self[each] for each in range(*index.indices(self._count))]
        at = index - self._first
        if not 0 <= at < len(self._made):
            at = self._make_block(range(self._count)[index])
        return self._made[at]

    def _make_block(self, index: int) -> int:
        """Make a message and those of its block; return its place among them."""
        self._first = index - index % BLOCK_POINTS
        end = self._first + (BLOCK_POINTS if index else 1)
        self._made = self._make(self._first, min(end, self._count))
        return index - self._first
