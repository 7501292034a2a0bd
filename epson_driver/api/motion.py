# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The object that represents a started motion: its progress, its result, and its cancellation."""

import asyncio
import contextlib
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

from epson_driver.api.errors import WORDS, MotionError, checked_timeout
from epson_driver.api.ownership import Unique
from epson_driver.driver.outcome import End, Outcome
from epson_driver.driver.remedy import with_remedy
from epson_driver.motion import Array

if TYPE_CHECKING:  # the driver is loaded with the first Robot
    from epson_driver.driver.goal.goal import Goal
    from epson_driver.driver.goal.goal_execution import GoalExecution
    from epson_driver.driver.goal.goal_queue import GoalQueue
    from epson_driver.driver.goal.planning_cancellation import PlanningCancellation
    from epson_driver.driver.state.robot_state import JointSample

_log = logging.getLogger(__name__)

# This log is not printed by default, because Motion objects and setpoint calls report its errors.
for _name in ('goal', 'servo'):
    logging.getLogger(f'epson_driver.driver.{_name}').addHandler(logging.NullHandler())

CheckedPath = tuple[Callable[[Array], float], float]
"""A function from joint positions, shape (n,), to the tool's distance from its path, m, and the
maximum distance, m."""


class Motion(Unique):
    """A motion of the arm. It ends exactly once: succeeded, canceled or aborted."""

    def __init__(
        self,
        queue: 'GoalQueue',
        goal: 'Goal',
        plan: 'PlanningCancellation',
        path: CheckedPath | None = None,
    ) -> None:
        from epson_driver.driver.goal.goal_queue import GoalHandle

        self._queue = queue
        self._planned = goal.trajectory.duration
        self._handle = GoalHandle(goal, self._on_end, self._on_feedback, plan=plan)
        self._path = path
        self._deviation = 0.0
        self._outcome: Outcome | None = None
        self._ended = asyncio.Event()
        self._reported = False

    def start(self) -> None:
        """Submit the motion to the driver. Raises MotionError if it is rejected immediately."""
        self._queue.submit(self._handle)
        if self._outcome is not None and self._outcome.end is End.ABORTED:
            self._reported = True
            raise MotionError(self._outcome)

    def __repr__(self) -> str:
        state = self.text or f'{self.progress:.0%} of {self.duration:.3g} s'
        return f'<Motion: {state}>'

    def __del__(self) -> None:
        outcome = getattr(self, '_outcome', None)
        if outcome is not None and outcome.end is End.ABORTED and not self._reported:
            _log.warning('a motion was aborted: %s', self.text)

    @property
    def done(self) -> bool:
        """True once the motion has ended, with any outcome."""
        return self._outcome is not None

    @property
    def text(self) -> str:
        """The result of the motion as a sentence, or '' while the motion runs."""
        if self._outcome is None:
            return ''
        message = with_remedy(self._outcome.text, self._outcome.remedy, WORDS)
        if self._path is not None and self._deviation > self._path[1]:
            message += (
                f'; the tool was up to {self._deviation * 1e3:.2f} mm away from its path '
                f'(accuracy {self._path[1] * 1e3:g} mm)'
            )
        return message

    @property
    def duration(self) -> float:
        """Planned duration at a speed scaling of 1, s."""
        return self._planned

    @property
    def progress(self) -> float:
        """Elapsed fraction of the planned time, 0 to 1. It is only 1 if the motion succeeded."""
        if self._outcome is not None and self._outcome.end is End.SUCCEEDED:
            return 1.0
        execution = self._handle.execution
        desired = None if execution is None else execution.desired
        if execution is None or desired is None:
            return 0.0
        return min(desired[0] / execution.goal.trajectory.duration, 0.999)

    async def wait(self, timeout: float | None = None) -> str:
        """Wait until the motion ends, and return its text.

        Raises MotionError unless the motion succeeded, and TimeoutError after `timeout` s. The
        motion continues after a timeout, and after a cancellation of the waiting task.
        """
        try:
            async with asyncio.timeout(checked_timeout(timeout)):
                outcome = await self._end()
        except TimeoutError as error:
            raise TimeoutError(f'the motion has not ended within {timeout:g} s') from error
        if outcome.end is not End.SUCCEEDED:
            raise MotionError(outcome)
        return self.text

    async def finish(self, timeout: float | None = None) -> str:
        """Wait until the motion ends, like `wait`, but stop the arm if the task is cancelled."""
        try:
            return await self.wait(timeout)
        except asyncio.CancelledError:
            with contextlib.suppress(MotionError):  # the cancellation is raised in any case
                await self.cancel()
            raise

    async def cancel(self) -> str:
        """Stop the arm, and return a message once the arm is at rest.

        If the motion has already ended, only return its result. Raises MotionError if the motion
        was aborted before it could be canceled.
        """
        if self._outcome is None:
            self._queue.cancel(self._handle)
        outcome = await self._end()
        if outcome.end is End.ABORTED:
            raise MotionError(outcome)
        return outcome.text

    async def _end(self) -> Outcome:
        self._reported = True
        await self._ended.wait()
        assert self._outcome is not None  # noqa: S101 - for the type checker
        return self._outcome

    def _on_feedback(self, _execution: 'GoalExecution', sample: 'JointSample') -> None:
        if self._path is not None:
            self._deviation = max(self._deviation, self._path[0](sample.positions))

    def _on_end(self, outcome: Outcome) -> None:
        self._outcome = outcome
        self._ended.set()
