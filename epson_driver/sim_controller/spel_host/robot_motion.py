# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motions of a SPEL+ program: one statement at a time moves the arm, from rest or blended in."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from epson_driver.motion import Array
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.arm.point_to_point import PointToPoint
from epson_driver.sim_controller.clock import Clock, Timer
from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.spel import MotionRequest, SpelError

SHORTEST_S = 1e-6
"""So much later, s, at most, it is seen that a motion is over: rounding cannot stop the clock."""


class Motion:
    """A motion statement that has begun; over when the arm stands, with CP when it decelerates."""

    def __init__(self, request: MotionRequest) -> None:
        self.request = request
        self.done = False
        self.error: SpelError | None = None


class RobotMotion:
    """Gives motion statements to the arm, and ends them; `news` is called when one is over.

    The condition of Till is looked at every `scan` s.
    """

    def __init__(
        self, arm: PointToPoint, clock: Clock, news: Callable[[], None], scan: float
    ) -> None:
        self._arm = arm
        self._period = scan
        self._clock = clock
        self._news = news
        self._motion: Motion | None = None
        self._points: deque[Point] = deque()  # of the statement, that the arm has not taken yet
        self._scan: Timer | None = None
        self._due: Timer | None = None
        self.till_on = False
        """Whether Till ended the last motion."""
        self.cp = False
        """CP On: every motion may blend into the next one."""
        self.lim_z = 0.0
        """LimZ: how high joint 3 goes for Jump, m."""

    @property
    def busy(self) -> bool:
        """Whether a statement is under way."""
        return self._motion is not None

    @property
    def start(self) -> Array:
        """Where the arm rests when the motions before are over, shape (n,), rad."""
        return self._arm.destination

    def begin(self, request: MotionRequest, points: Sequence[Point]) -> Motion:
        """Begin a motion to points, one after the other. Raises SpelError if one is under way.

        The last one blends into the next motion if that is asked for; between them the arm rests.
        An arm that brakes comes to a stand first.
        """
        if self._motion is not None:
            text = 'a motion of another task is under way'
            raise SpelError(ErrorNumber.MOTION_ABORTED, f'{request.name}: {text}')
        self._motion = motion = Motion(request)
        *before, last = points
        self._points = deque([*before, replace(last, cp=self.cp or request.cp)])
        self.till_on = False
        if request.till is not None:
            self._scan = self._clock.every(self._period, self._look, first=self._period)
        self._look()
        self.settle()
        return motion

    def settle(self) -> None:
        """See what has become of the statement; keep a timer for when that changes next."""
        while self._points and self._arm.has_room:
            self._arm.take(self._points.popleft())
        if self._motion is not None and not self._points and self._arm.done:
            self._end(None)
        if self._due is not None:
            self._due.cancel()
            self._due = None
        due = self._arm.due_in
        if due < math.inf and not self._arm.still:
            self._due = self._clock.after(max(due, SHORTEST_S), self.settle)

    def abort(self, error: SpelError) -> bool:
        """Brake; the statement under way ends with an error. Return whether there was one."""
        self._arm.stop()
        ended = self._end(error)
        self.settle()
        return ended

    def _end(self, error: SpelError | None) -> bool:
        motion, self._motion = self._motion, None
        self._points.clear()
        if self._scan is not None:
            self._scan.cancel()
            self._scan = None
        if motion is None:
            return False
        motion.error, motion.done = error, True
        self._news()
        return True

    def _look(self) -> None:
        """Look at the condition of Till: where it holds, the arm brakes."""
        motion = self._motion
        if motion is None or motion.request.till is None or self.till_on:
            return
        try:
            holds = motion.request.till()
        except SpelError as error:
            self.abort(error)
            return
        if holds:
            self.till_on = True
            self._points.clear()
            self._arm.stop()
            self.settle()
