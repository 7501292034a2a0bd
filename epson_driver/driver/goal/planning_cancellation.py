# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Cancellation of goals whose motion is still being planned.

Planning takes up to several seconds. After a stop, disable or new motion, no request made earlier
may move the arm, even if the arm has been enabled again. Therefore goals that are being planned
end together with the waiting goals.
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
    """Raised if a goal was canceled during planning. The text contains the reason."""


class PlanningCancellation:
    """Cancellation of one goal that is being planned. Any thread may create it."""

    def __init__(self) -> None:
        self.why: str | None = None  # reason for the cancellation, or None if the goal may start
        self._ended: asyncio.Future[None] | None = None

    def end(self, why: str) -> None:
        if self.why is None:
            self.why = why
            if self._ended is not None and not self._ended.done():
                self._ended.set_result(None)

    def check(self) -> None:
        if self.why is not None:
            raise PlanningEndedError(self.why)

    async def in_thread(self, work: Callable[[Callable[[], None]], T]) -> T:
        """Run `work` in a thread, and return its result or raise its exception.

        Raises PlanningEndedError as soon as the goal is canceled, without waiting for the thread.
        `work` receives a function, and must call it at each step. If the goal is canceled, the
        function raises PlanningEndedError, so that the thread ends early. (The process waits for
        its threads when it exits.)
        """
        self.check()
        loop = asyncio.get_running_loop()
        abandoned = threading.Event()
        self._ended = loop.create_future()

        def check_needed() -> None:
            if abandoned.is_set():
                raise PlanningEndedError(self.why or 'the planning was canceled')

        planning = loop.run_in_executor(None, copy_context().run, work, check_needed)
        planning.add_done_callback(lambda done: _log_error(done, abandoned=abandoned.is_set()))
        try:
            either: set[asyncio.Future[Any]] = {planning, self._ended}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            self.check()
            return planning.result()
        finally:
            abandoned.set()


class PlanningCancellations:
    """All goals of a driver that are being planned. Used only in the driver's event loop."""

    def __init__(self) -> None:
        self._plans: WeakValueDictionary[int, PlanningCancellation] = WeakValueDictionary()
        self._numbers = count()

    def begin(self, plan: PlanningCancellation | None = None) -> PlanningCancellation:
        """Register a goal, so that `end` cancels it. Only a weak reference is stored."""
        plan = PlanningCancellation() if plan is None else plan
        self._plans[next(self._numbers)] = plan
        return plan

    def end(self, why: str) -> None:
        for plan in list(self._plans.values()):
            plan.end(why)
        self._plans.clear()


def _log_error(done: 'asyncio.Future[T]', *, abandoned: bool) -> None:
    """Log an unexpected error of a planning thread. `abandoned`: its caller no longer waits."""
    if done.cancelled():
        return
    error = done.exception()
    if abandoned and error is not None and not isinstance(error, ValueError | PlanningEndedError):
        _log.warning('planning of a cancelled goal failed: %r', error)
