# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Cancellation of goals whose motion is still being planned.

Planning takes up to several seconds. After a stop, disable or new motion, no request made earlier
may move the arm, even if it has been enabled again. Goals in planning therefore end together with
the waiting goals.
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
    """The goal must not start any more. The text contains the reason."""


class PlanningScope:
    """A goal that is being planned. Created in any thread, used in the driver's loop."""

    def __init__(self) -> None:
        self.why: str | None = None
        """Why the goal must not start, or None if it may."""
        self._ended: asyncio.Future[None] | None = None

    def end(self, why: str) -> None:
        """Cancel the goal before it starts, and wake up the caller waiting for its plan."""
        if self.why is None:
            self.why = why
            if self._ended is not None and not self._ended.done():
                self._ended.set_result(None)

    def check(self) -> None:
        """Raise PlanningEndedError if the goal must not start any more."""
        if self.why is not None:
            raise PlanningEndedError(self.why)

    async def in_thread(self, work: Callable[[Callable[[], None]], T]) -> T:
        """Run `work` in a thread, and return its result or raise its exception.

        `work` must call its argument at each step. The argument raises PlanningEndedError once the
        result is not needed, because the process waits for its threads when it exits. Raises
        PlanningEndedError as soon as the goal is canceled, without waiting for the thread.
        """
        self.check()
        loop = asyncio.get_running_loop()
        left = threading.Event()
        self._ended = loop.create_future()

        def look() -> None:
            if left.is_set():
                raise PlanningEndedError(self.why or 'the result is no longer needed')

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
        """Register a new or given plan, to be canceled with the others, and return it.

        The registration ends automatically with the last reference to the plan.
        """
        plan = PlanningScope() if plan is None else plan
        self._plans[next(self._numbers)] = plan
        return plan

    def end(self, why: str) -> None:
        """Cancel all registered goals, in the order of their registration."""
        for plan in list(self._plans.values()):
            plan.end(why)
        self._plans.clear()


def _take(done: 'asyncio.Future[T]', *, left: bool) -> None:
    """Retrieve the exception of a plan without a waiting caller, usually its cancellation."""
    if done.cancelled():
        return
    error = done.exception()
    if left and error is not None and not isinstance(error, ValueError | PlanningEndedError):
        _log.warning('planning of a cancelled goal failed: %r', error)
