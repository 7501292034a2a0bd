# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals whose motion is still being planned, and which end with the waiting goals.

Planning takes up to seconds. Who stops, disables or moves the arm meanwhile must be sure that
nothing moves afterwards that was asked for before, also if the arm is enabled again by then.
"""

import asyncio
import logging
import threading
from collections.abc import Callable
from contextvars import copy_context
from itertools import count
from typing import Any, TypeVar
from weakref import WeakValueDictionary

T = TypeVar('T')

_log = logging.getLogger(__name__)


class PlanningEndedError(RuntimeError):
    """A goal must not begin any more, with the reason as its text."""


class PlanningScope:
    """A goal that is being planned, made in any thread and used in the driver's loop."""

    def __init__(self) -> None:
        self.why: str | None = None
        """Why the goal must not begin any more; None: it may."""
        self._ended: asyncio.Future[None] | None = None

    def end(self, why: str) -> None:
        """Cancel the goal before it begins, and tell whoever waits for its planning."""
        if self.why is None:
            self.why = why
            if self._ended is not None and not self._ended.done():
                self._ended.set_result(None)

    def check(self) -> None:
        """Raise PlanningEndedError if the goal must not begin any more."""
        if self.why is not None:
            raise PlanningEndedError(self.why)

    async def in_thread(self, work: Callable[[Callable[[], None]], T]) -> T:
        """Plan in a thread and return what `work` returns, or raise what it raises.

        `work` must call its argument at each step, which raises PlanningEndedError once the result
        is not needed: the process waits for its threads at its end. Raises PlanningEndedError as
        soon as the goal must not begin.
        """
        self.check()
        loop = asyncio.get_running_loop()
        left = threading.Event()
        self._ended = loop.create_future()

        def look() -> None:
            if left.is_set():
                raise PlanningEndedError(self.why or 'the result is not needed any more')

        planning = loop.run_in_executor(None, copy_context().run, work, look)
        planning.add_done_callback(lambda done: _take(done, left=left.is_set()))
        try:
            either: set[asyncio.Future[Any]] = {planning, self._ended}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            self.check()
            return planning.result()
        finally:
            left.set()


class PlanningScopes:
    """All goals of a driver that are being planned. Everything runs in the driver's loop."""

    def __init__(self) -> None:
        self._plans: WeakValueDictionary[int, PlanningScope] = WeakValueDictionary()
        self._numbers = count()

    def begin(self, plan: PlanningScope | None = None) -> PlanningScope:
        """Return a new plan, or the one given: from now on it is ended with the others.

        As long as somebody has it; there is no need to take it away.
        """
        plan = PlanningScope() if plan is None else plan
        self._plans[next(self._numbers)] = plan
        return plan

    def end(self, why: str) -> None:
        """Let none of them begin any more, in the order in which they came."""
        for plan in list(self._plans.values()):
            plan.end(why)


def _take(done: 'asyncio.Future[T]', *, left: bool) -> None:
    """Retrieve the exception of a plan nobody waits for any more, usually that it was given up."""
    if done.cancelled():
        return
    error = done.exception()
    if left and error is not None and not isinstance(error, ValueError | PlanningEndedError):
        _log.warning('planning failed, for a goal that was given up: %r', error)
