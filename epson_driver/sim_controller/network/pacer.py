# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Lets real time pass for the core, which has no clock of its own that runs."""

import asyncio
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from epson_driver.sim_controller.core import CYCLE_PERIOD_S, Controller


class Pacer:
    """Steps the controller by the time that has really passed.

    It does so in every motion cycle while the arm moves, whenever a timer is due, and before
    anything else is done with the controller, which is done within `present`. Motion cycles that
    came a whole period late are counted in the controller's `timing`.
    """

    def __init__(self, controller: Controller, clock: Callable[[], float] | None = None) -> None:
        self._controller = controller
        self._clock = clock or asyncio.get_running_loop().time
        self._now = self._clock()
        self._cycle = math.inf
        self._sleeps_until = -math.inf
        self._wake = asyncio.Event()
        self._error: BaseException | None = None

    @contextmanager
    def present(self) -> Iterator[Controller]:
        """Bring the controller up to this moment for use, then see when its next step is due."""
        self._catch_up()
        try:
            yield self._controller
        finally:
            if self._due() < self._sleeps_until:
                self._wake.set()

    async def run(self) -> None:
        """Step the controller when its next timer is due, and every cycle while the arm moves."""
        while True:
            await self._sleep(self._due())
            if self._error is not None:
                raise self._error
            self._catch_up()
            if self._now >= self._cycle:
                self._cycle += CYCLE_PERIOD_S
                if self._now >= self._cycle:
                    self._controller.timing.deadline_misses += 1
                    self._cycle = self._now + CYCLE_PERIOD_S

    def see_end(self, task: 'asyncio.Task[None]') -> None:
        """Have `run` raise what the task of a client has raised: that is a defect."""
        if not task.cancelled() and (error := task.exception()) is not None:
            self._error = error
            self._wake.set()

    def _due(self) -> float:
        """Return when the controller must be stepped next, on the real clock."""
        controller = self._controller
        if not controller.in_motion:
            self._cycle = math.inf
        elif self._cycle == math.inf:
            self._cycle = self._now + CYCLE_PERIOD_S
        due = controller.clock.next_due
        if due is None:
            return self._cycle
        return min(self._cycle, self._now + due - controller.clock.now)

    async def _sleep(self, until: float) -> None:
        self._sleeps_until = until
        timer = None
        if until < math.inf:
            loop = asyncio.get_running_loop()
            timer = loop.call_later(max(until - self._clock(), 0.0), self._wake.set)
        await self._wake.wait()
        self._wake.clear()
        self._sleeps_until = -math.inf
        if timer is not None:
            timer.cancel()

    def _catch_up(self) -> None:
        now = self._clock()
        elapsed = now - self._now
        self._now = now
        self._controller.step(elapsed)
