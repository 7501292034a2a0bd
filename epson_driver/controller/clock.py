# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's time, which only passes when it is told to, and what is to happen when."""

import heapq
from collections.abc import Callable
from itertools import count

Action = Callable[[], None]

FEW = 64
"""Timers that may wait before the cancelled ones among them are looked for."""


class Timer:
    """Something that will happen once, until it is cancelled. Made by `Clock.after`."""

    __slots__ = ('action', 'due')

    def __init__(self, due: float, action: Action) -> None:
        self.due = due
        self.action: Action | None = action

    def cancel(self) -> None:
        """Let it not happen. Twice, or afterwards, is no error."""
        self.action = None


class Clock:
    """Time in s since the start, and timers in the order in which they are due.

    Timers that are due at the same moment act in the order in which they were set: the same calls
    give the same order.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self._timers: list[tuple[float, int, Timer]] = []
        self._numbers = count()
        self._most = FEW

    @property
    def next_due(self) -> float | None:
        """When the next timer acts, s; None if there is none."""
        while self._timers and self._timers[0][2].action is None:
            heapq.heappop(self._timers)
        return self._timers[0][0] if self._timers else None

    def after(self, delay: float, action: Action) -> Timer:
        """Have `action` called `delay` ≥ 0 s from now."""
        if len(self._timers) >= self._most:
            self._drop_cancelled()
        timer = Timer(self.now + delay, action)
        heapq.heappush(self._timers, (timer.due, next(self._numbers), timer))
        return timer

    def _drop_cancelled(self) -> None:
        """Keep no more memory than the timers need that will act."""
        self._timers = [entry for entry in self._timers if entry[2].action is not None]
        heapq.heapify(self._timers)
        self._most = max(FEW, 2 * len(self._timers))

    def advance(self, until: float) -> None:
        """Let the time be `until`, and what is due by then happen.

        An action sees the moment it is due as now, and may set further timers.
        """
        while (due := self.next_due) is not None and due <= until:
            _, _, timer = heapq.heappop(self._timers)
            self.now = max(self.now, due)
            action, timer.action = timer.action, None
            if action is not None:
                action()
        self.now = max(self.now, until)
