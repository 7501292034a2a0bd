# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's clock: real time for a core that has none."""

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from epson_driver.controller.core import Controller


class Pacer:
    """Lets the time that really passed pass for the controller too.

    Everything else gets at the controller through `present`. Motion cycles that came a whole
    period late are counted in the controller's `timing`.
    """

    def __init__(
        self, controller: Controller, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._controller = controller
        self._clock = clock
        self._now = clock()
        self._moving = asyncio.Event()

    @contextmanager
    def present(self) -> Iterator[Controller]:
        """Give out the controller as it is at this moment; wake the cycle if it moves then."""
        self._catch_up()
        try:
            yield self._controller
        finally:
            if self._controller.moving:
                self._moving.set()

    async def run(self) -> None:
        """Step the controller every cycle period while the arm moves; sleep while it stands."""
        period = self._controller.profile.cycle_period
        while True:
            await self._moving.wait()
            self._moving.clear()
            due = self._clock() + period
            while self._controller.moving:
                await asyncio.sleep(due - self._clock())
                self._catch_up()
                due += period
                if self._now >= due:
                    self._controller.timing.deadline_misses += 1
                    due = self._now + period

    def _catch_up(self) -> None:
        now = self._clock()
        elapsed = now - self._now
        self._now = now
        self._controller.step(elapsed)
