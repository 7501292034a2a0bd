# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A motion that was begun: how far it has come, its end, and canceling it."""

import asyncio
import logging

from epson_driver.api.errors import MotionError, in_python
from epson_driver.driver.goal.goal import Goal
from epson_driver.driver.goal.goal_queue import GoalHandle, GoalQueue
from epson_driver.driver.outcome import End, Outcome

_log = logging.getLogger(__name__)


class Motion:
    """A motion of the arm. It ends once: it succeeded, was canceled, or was aborted."""

    def __init__(self, queue: GoalQueue, goal: Goal) -> None:
        self._queue = queue
        self._planned = goal.trajectory.duration
        self._handle = GoalHandle(goal, self._on_end, lambda _execution, _sample: None)
        self._outcome: Outcome | None = None
        self._ended = asyncio.Event()
        self._told = False

    def begin(self) -> None:
        """Hand it to the driver. Raises MotionError if that refuses it at once."""
        self._queue.submit(self._handle)
        if self._outcome is not None and self._outcome.end is End.ABORTED:
            self._told = True
            raise MotionError(self._outcome)

    @property
    def done(self) -> bool:
        """True once it has ended, however."""
        return self._outcome is not None

    @property
    def text(self) -> str:
        """How it ended, in a sentence; '' before."""
        return '' if self._outcome is None else in_python(self._outcome.text)

    @property
    def duration(self) -> float:
        """How long it is planned to take, s, at a speed scaling of 1."""
        return self._planned

    @property
    def progress(self) -> float:
        """The share of its planned time that has passed, 0 to 1; 1 only when it has succeeded."""
        if self._outcome is not None and self._outcome.end is End.SUCCEEDED:
            return 1.0
        execution = self._handle.execution
        desired = None if execution is None else execution.desired
        if execution is None or desired is None:
            return 0.0
        return min(desired[0] / execution.goal.trajectory.duration, 0.999)

    async def wait(self) -> str:
        """Wait for its end; return a sentence. Raises MotionError unless it succeeded.

        Who gives up waiting (cancellation, a time-out) does not end the motion: `cancel` does.
        """
        outcome = await self._end()
        if outcome.end is not End.SUCCEEDED:
            raise MotionError(outcome)
        return in_python(outcome.text)

    async def cancel(self) -> str:
        """Stop the arm; return a sentence when it stands. Nothing if the motion has ended.

        Raises MotionError if it was aborted meanwhile: its text says what is known of the arm.
        """
        if self._outcome is None:
            self._queue.cancel(self._handle)
        outcome = await self._end()
        if outcome.end is End.ABORTED:
            raise MotionError(outcome)
        return in_python(outcome.text)

    async def _end(self) -> Outcome:
        self._told = True
        await self._ended.wait()
        assert self._outcome is not None  # noqa: S101 - for the type checker
        return self._outcome

    def _on_end(self, outcome: Outcome) -> None:
        self._outcome = outcome
        self._ended.set()
        if outcome.end is End.ABORTED and not self._told:
            _log.warning('a motion that nobody waits for was aborted: %s', self.text)
