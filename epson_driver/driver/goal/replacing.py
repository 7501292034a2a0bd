# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whether a running goal is left for the next one on the way, or stopped for it."""

import logging
import math

from epson_driver.driver.goal.goal_execution import GoalExecution, Successor
from epson_driver.driver.goal.handover import LATEST_SHARE, lead
from epson_driver.motion import JointLimits

REPLACED = 'replaced by a new goal'

_log = logging.getLogger(__name__)


class Replacing:
    """Replaces one running goal after the other. Times (`now`) are the loop's, s.

    `on_the_way`: without a stop where that can be and comes soon enough (handover.py); else each
    is stopped.
    """

    def __init__(self, limits: JointLimits, *, on_the_way: bool) -> None:
        self.on_the_way = on_the_way
        self.lead = lead(limits) if on_the_way else math.inf
        """How far ahead of its clock a goal is sent, s."""
        self._by: float | None = None

    @property
    def pending(self) -> bool:
        """Whether a goal is to be left as soon as its point is answered."""
        return self._by is not None

    def replace(self, execution: GoalExecution, successor: Successor, now: float) -> None:
        """Have `successor` called when the running goal can be left, or stop it."""
        if not self.on_the_way:
            execution.stop(REPLACED, now)
            return
        reach, latest = execution.reach, LATEST_SHARE * self.lead
        if reach is None:
            self.stop(execution, 'it could not be left on the way', now)
        elif reach > latest:
            text = f'the controller has points of it for {reach:.2g} s, more than {latest:.2g} s'
            self.stop(execution, text, now)
        else:
            self._by = now + latest if self._by is None else self._by
            execution.hand_over(successor, now)

    def check(self, execution: GoalExecution, now: float) -> None:
        """Stop the running goal if it should have been left by now."""
        if self._by is not None and now > self._by:
            text = 'the point that is on its way was not answered in time'
            self.stop(execution, text, now)

    def stop(self, execution: GoalExecution, why: str, now: float) -> None:
        """Stop the running goal for the next one."""
        self._by = None
        _log.info('the running goal is stopped for the new one: %s', why)
        execution.keep()
        execution.stop(REPLACED, now)

    def done(self) -> None:
        """Forget that a goal was to be left."""
        self._by = None
