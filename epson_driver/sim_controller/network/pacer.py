# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Advances the simulated controller by the elapsed real time."""

import asyncio
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import copy_context

from epson_driver.sim_controller.core import CYCLE_PERIOD_S, Controller


class Pacer:
    """Steps the controller by the elapsed real time.

    The controller is stepped when a timer is due, before any other code uses it, which must happen
    within `present`, and a motion cycle after the last step while the arm moves. Steps that are
    late by a whole cycle are counted in the controller's `timing`.
    """

    def __init__(self, controller: Controller, clock: Callable[[], float] | None = None) -> None:
        self._controller = controller
        self._clock = clock or asyncio.get_running_loop().time
        self._now = self._clock()
        self._cycle = math.inf
        self._error: BaseException | None = None
        self._failed: asyncio.Future[None] | None = None  # gets a step's exception
        self._timer: asyncio.TimerHandle | None = None
        self._context = copy_context()
        self._sleeps_until = -math.inf

    @contextmanager
    def present(self) -> Iterator[Controller]:
        """Advance the controller to the current time, yield it, and schedule its next step."""
        self._catch_up()
        try:
            yield self._controller
        finally:
            if (due := self._due()) < self._sleeps_until:
                self._sleep(due)

    async def run(self) -> None:
        """Step the controller until a step fails. Raises its exception."""
        self._failed = asyncio.get_running_loop().create_future()
        self._context = copy_context()
        if self._error is not None:
            raise self._error
        self._sleep(self._due())
        try:
            await self._failed
        finally:
            self._sleep(math.inf)
            self._failed, self._sleeps_until = None, -math.inf

    def on_task_done(self, task: 'asyncio.Task[None]') -> None:
        """Make `run` raise the exception of a failed client task, because it is a defect."""
        if not task.cancelled() and (error := task.exception()) is not None:
            self.fail(error)

    def fail(self, error: BaseException) -> None:
        """Make `run` raise an exception, because it shows a defect."""
        self._error = error
        if self._failed is not None and not self._failed.done():
            self._failed.set_exception(error)

    def _step(self) -> None:
        """Step the controller.

        The event loop calls this function directly, because waking a task costs three calls.
        """
        try:
            self._catch_up()
        except Exception as error:  # noqa: BLE001 - raised by `run`
            self.fail(error)
            return
        self._sleep(self._due())

    def _due(self) -> float:
        controller = self._controller
        self._cycle = self._now + CYCLE_PERIOD_S if controller.in_motion else math.inf
        due = controller.clock.next_due
        if due is None:
            return self._cycle
        return min(self._cycle, self._now + due - controller.clock.now)

    def _sleep(self, until: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._sleeps_until = until
        if until < math.inf:
            loop, delay = asyncio.get_running_loop(), max(until - self._clock(), 0.0)
            self._timer = loop.call_later(delay, self._step, context=self._context)

    def _catch_up(self) -> None:
        now = self._clock()
        self._controller.timing.deadline_misses += now >= self._cycle + CYCLE_PERIOD_S
        elapsed = now - self._now
        self._now = now
        self._controller.step(elapsed)
