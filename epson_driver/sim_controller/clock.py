# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The time of the controller, which its caller advances, and its timers.

The clock never reads the real time. The same calls therefore give the same results, and a
simulation can run faster than real time. After a long step the missed timers run in order, each at
its own due time. A periodic timer makes up for a limited number of missed calls.
"""

import heapq
from collections.abc import Callable
from itertools import count

Action = Callable[[], None]

MIN_TIMERS_TO_SWEEP = 64
"""Minimum number of stored timers at which cancelled timers are removed."""


class Timer:
    """A scheduled action, once or every `period` s, see `Clock.every`."""

    __slots__ = ('action', 'catch_up', 'due', 'period')

    def __init__(
        self, due: float, action: Action, period: float | None = None, catch_up: int = 0
    ) -> None:
        self.due = due
        self.action: Action | None = action
        self.period = period
        self.catch_up = catch_up

    def cancel(self) -> None:
        self.action = None


def _nothing(_seconds: float) -> None:
    pass


class Clock:
    """A clock with timers. `now`: current time, s. `until`: time to which it advances, s.

    Timers that are due at the same time run in the order of their creation.
    """

    def __init__(self) -> None:
        self.now = self.until = 0.0
        self._timers: list[tuple[float, int, Timer]] = []
        self._numbers = count()
        self._sweep_threshold = MIN_TIMERS_TO_SWEEP

    @property
    def timers(self) -> int:
        """Number of stored timers, including cancelled ones that are not yet removed."""
        return len(self._timers)

    @property
    def next_due(self) -> float | None:
        while self._timers and self._timers[0][2].action is None:
            heapq.heappop(self._timers)
        return self._timers[0][0] if self._timers else None

    def after(self, delay: float, action: Action) -> Timer:
        return self._set(Timer(self.now + delay, action))

    def every(self, period: float, action: Action, first: float = 0.0, catch_up: int = 0) -> Timer:
        """Schedule a call of `action` every `period` > 0 s, first in `first` s.

        After a step longer than the period, up to `catch_up` ≥ 0 missed calls are made before the
        newest one. Older calls are skipped.
        """
        return self._set(Timer(self.now + first, action, period, catch_up))

    def advance(self, until: float, elapse: Callable[[float], None] = _nothing) -> None:
        """Advance the time to `until`, and run the timers due by then.

        The time proceeds from one timer to the next. Before each timer, and once at the end,
        `elapse` is called with the time, s, since its previous call. The core then advances the
        arm by this time, so each action sees the arm's position at the action's due time, however
        late this call is. Timers set by an action run in the same call if they are due by `until`.
        """
        self.until = until
        while (due := self.next_due) is not None and due <= until:
            timer = self._timers[0][2]
            if timer.period is not None and self._skip(timer, timer.period, until):
                continue
            self._pass(due, elapse)
            if self.next_due == due:  # not cancelled by `elapse`
                self._act(heapq.heappop(self._timers)[2])
        self._pass(until, elapse)

    def _pass(self, until: float, elapse: Callable[[float], None]) -> None:
        elapsed = max(until - self.now, 0.0)
        self.now = max(self.now, until)
        elapse(elapsed)

    def _skip(self, timer: Timer, period: float, until: float) -> bool:
        too_many = int((until - timer.due) / period) - timer.catch_up
        if too_many <= 0:
            return False
        heapq.heappop(self._timers)
        timer.due += too_many * period
        self._set(timer)
        return True

    def _act(self, timer: Timer) -> None:
        action = timer.action
        if timer.period is None:
            timer.action = None
        else:
            timer.due += timer.period
            self._set(timer)
        if action is not None:
            action()

    def _set(self, timer: Timer) -> Timer:
        if len(self._timers) >= self._sweep_threshold:
            self._drop_cancelled()
        heapq.heappush(self._timers, (timer.due, next(self._numbers), timer))
        return timer

    def _drop_cancelled(self) -> None:
        """Remove cancelled timers, so the memory depends only on the active ones."""
        self._timers = [entry for entry in self._timers if entry[2].action is not None]
        heapq.heapify(self._timers)
        self._sweep_threshold = max(MIN_TIMERS_TO_SWEEP, 2 * len(self._timers))
