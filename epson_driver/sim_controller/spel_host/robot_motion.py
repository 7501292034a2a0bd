# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Execution of the motion statements of a SPEL+ program, one at a time."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array
from epson_driver.sim_controller.arm.arch import Arch
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.arm.point_to_point import PointToPoint
from epson_driver.sim_controller.clock import Clock, Timer
from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.spel import MotionRequest, SpelError

SHORTEST_S = 1e-6
"""Minimum delay of the timer for a motion's next event, s.

It ensures that the clock advances.
"""


class Motion:
    """A motion statement. It ends when the arm is at rest, or with CP, when the arm decelerates.

    `done`: whether it has ended. `error`: the error that ended it early, if any.
    """

    def __init__(self, request: MotionRequest, fraction: Callable[[], float]) -> None:
        self.request = request
        self._fraction = fraction
        self.done = False
        self.error: SpelError | None = None

    @property
    def fraction(self) -> float:
        """Completed fraction of the path, 0 to 1.

        In a jump, only the move across counts, and the fraction is -1 before this move.
        """
        return 1.0 if self.done else self._fraction()


class RobotMotion:
    """Executes motion statements. Till and Find are evaluated every `scan` s."""

    def __init__(
        self,
        arm: PointToPoint,
        clock: Clock,
        news: Callable[[], None],
        scan: float,
    ) -> None:
        self._arm = arm
        self._period = scan
        self._clock = clock
        self._news = news
        self._motion: Motion | None = None
        self._points: deque[Point] = deque()  # not yet accepted by the arm
        self._scan: Timer | None = None
        self._due: Timer | None = None
        self.till_on = False  # whether Till ended the last motion
        self.sensed = False  # whether Sense ended the last Jump above its target
        self.find_position: Array | None = None  # position at which Find was met, rad
        self._down: Point | None = None  # target of Jump … Sense if the condition is not met
        self._arch: Arch | None = None  # the arch of the current motion
        self._stops: list[Array] = []  # start and targets of the motion
        self.cp = False  # whether every motion may blend into the next one
        self.passes = False  # whether the last motion was a Pass, which blends into a Pass only
        self.lim_z = 0.0  # value of LimZ, m

    @property
    def busy(self) -> bool:
        return self._motion is not None

    @property
    def start(self) -> Array:
        """Rest position after all earlier motions, shape (n,), rad."""
        return self._arm.destination

    def execute(self, request: MotionRequest, points: Sequence[Point]) -> Motion:
        """Start a motion that stops at each point.

        If the request has CP, it does not stop at the last one.
        """
        if self._motion is not None:
            text = 'another task is moving the robot'
            raise SpelError(ErrorNumber.MOTION_ABORTED, f'{request.name.capitalize()}: {text}')
        self._motion = motion = Motion(request, self._fraction)
        self._stops = [self.start, *(point.target for point in points)]
        path = points[0].path
        self._arch = path if isinstance(path, Arch) else None
        self.passes = request.name == 'pass'
        *before, last = points
        self._points = deque([*before, replace(last, cp=self.cp or request.cp or self.passes)])
        self._down = self._points.pop() if request.sense is not None and before else None
        self.till_on = self.sensed = False
        if request.find is not None:
            self.find_position = None
        if request.till is not None or request.find is not None:
            self._scan = self._clock.every(
                self._period, self._evaluate_conditions, first=self._period
            )
        self._evaluate_conditions()
        self.update()
        return motion

    def update(self) -> None:
        while self._points and self._arm.has_room:
            self._arm.take(self._points.popleft())
        if self._motion is not None and not self._points and self._arm.done:
            if self._goes_down():
                return
            self._end(None)
        if self._due is not None:
            self._due.cancel()
            self._due = None
        due = self._arm.due_in
        if due < math.inf and not self._arm.at_rest:
            self._due = self._clock.after(max(due, SHORTEST_S), self.update)

    def abort(self, error: SpelError) -> bool:
        self._arm.stop()
        ended = self._end(error)
        self.update()
        return ended

    def _goes_down(self) -> bool:
        """Evaluate Sense when the arm is above the target of a Jump.

        Return whether the statement continues.
        """
        motion, down = self._motion, self._down
        self._down = None
        if motion is None or down is None or motion.request.sense is None or self.till_on:
            return False
        try:
            self.sensed = bool(motion.request.sense())
        except SpelError as error:
            self.abort(error)
            return True
        if not self.sensed:
            self._points.append(down)
            self.update()
        return not self.sensed

    def _fraction(self) -> float:
        """Return the completed fraction of the path, by its length in joint space.

        In a jump only the move across counts, because the statements in `!…!` are executed in
        parallel with it (SPEL+ manual p57). Before this move the result is -1.
        """
        stops, position = self._stops, self._arm.position
        parts = [float(np.linalg.norm(b - a)) for a, b in pairwise(stops)]
        target = len(parts) - len(self._points) - (self._down is not None)
        if self._arch is not None:
            return self._arch.across(self._arm.elapsed)
        if self._motion is not None and self._motion.request.name.startswith('jump'):
            if target != 2:
                return -1.0 if target < 2 else 1.0
            parts, stops, target = parts[1:2], stops[1:3], 1
        remaining = sum(parts[target:])
        remaining += float(np.linalg.norm(stops[target] - position))
        whole = sum(parts)
        return min(max(1.0 - remaining / whole, 0.0), 1.0) if whole else 1.0

    def _end(self, error: SpelError | None) -> bool:
        motion, self._motion = self._motion, None
        self._points.clear()
        self._down = None
        if self._scan is not None:
            self._scan.cancel()
            self._scan = None
        if motion is None:
            return False
        motion.error, motion.done = error, True
        self._news()
        return True

    def _evaluate_conditions(self) -> None:
        motion = self._motion
        if motion is None or self.till_on:
            return
        request = motion.request
        try:
            finds = request.find is not None and self.find_position is None and request.find()
            self.till_on = request.till is not None and bool(request.till())
        except SpelError as error:
            self.abort(error)
            return
        if finds:
            self.find_position = self._arm.position
        if self.till_on:
            self._points.clear()
            self._down = None
            self._arm.stop()
            self.update()
