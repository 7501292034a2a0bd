# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smooth motion: the arm goes through points that are known ahead, without a stop."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from epson_driver.controller.executor import Point
from epson_driver.controller.planning_latency import PlanningLatency
from epson_driver.controller.points import clipped
from epson_driver.controller.timing import Timing
from epson_driver.motion import Array, JointLimits
from epson_driver.motion.smoother import Plan, Request, Smoother

ATTEMPTS = 10
"""Plans from rest that may fail one after the other before that counts as a failure."""

Answer = Callable[[Plan | None], None]


class Planner(Protocol):
    """Who plans; one request at a time."""

    @property
    def ready(self) -> bool:
        """Whether it can be asked at all."""

    def ask(self, request: Request, answer: Answer) -> None:
        """Have a request planned, at once or elsewhere. `answer` is called exactly once."""


class Streaming:
    """An arm that goes smoothly through streamed points, inside its limits.

    A point is answered when it is taken: points are taken while less than `look_ahead` s and fewer
    than `look_ahead_points` points are known ahead of the arm. Its duration is kept where the
    limits allow that; without one, its velocity is a fraction of the joints' speed in (0, 1), and
    without that too it is as fast as the limits allow. The profile's Speed and Accel percentages
    are those of SPEL+'s point-to-point `Go` and do not count here: the robot's limits do.

    `failed` is told why when no plan is found at rest again and again. Raises ValueError for a
    start that is not n finite angles within the limits.
    """

    def __init__(
        self,
        limits: JointLimits,
        start: Array,
        planner: Planner,
        timing: Timing,
        failed: Callable[[str], None],
        look_ahead: float,
        look_ahead_points: int,
    ) -> None:
        self.limits = limits
        self._latency = PlanningLatency()
        self._smoother = Smoother(limits, start, latency=self._latency.value, planner=None)
        self._planner = planner
        self._timing = timing
        self._failed = failed
        self._look_ahead = look_ahead
        self._look_ahead_points = look_ahead_points
        self._now = 0.0
        self._position = clipped(start, limits)
        self._goal: Array | None = None
        self._braking = False
        # The request that the planner has, since when, and whether it was forgotten meanwhile.
        self._request: Request | None = None
        self._asked_at = 0.0
        self._forgotten = False
        self._in_vain = 0

    @property
    def moving(self) -> bool:
        """Whether the arm moves, is about to, or rests for a commanded time."""
        return self._smoother.moving

    @property
    def has_room(self) -> bool:
        """Whether little enough is known ahead; not while the arm brakes."""
        return (
            not self._braking
            and self._smoother.waiting < self._look_ahead_points
            and self._smoother.look_ahead < self._look_ahead
        )

    @property
    def done(self) -> bool:
        """True: a point is answered as soon as it is taken."""
        return True

    @property
    def position(self) -> Array:
        """The commanded joint angles now, shape (n,), rad."""
        return self._position

    def take(self, point: Point) -> None:
        """Go on to a point. A sequence of 0 begins a new trajectory; the one before ends at rest.

        Raises ValueError as `Smoother.append` does.
        """
        if point.sequence == 0:
            self._smoother.finish()
        self._smoother.append(point.target, self._duration(point))
        self._goal = point.target

    def stop(self) -> bool:
        """Forget all points and come to rest, on the path if that can be verified.

        Return whether the arm was not at the last of them yet.
        """
        lost = self.moving and not self._braking
        self._smoother.stop()
        self._braking = self._smoother.moving
        self._forgotten = self._request is not None
        self._goal = None
        return lost

    def step(self, dt: float) -> None:
        """Let `dt` ≥ 0 s pass, and ask for a plan if there is something to plan."""
        self._now += dt
        self._position = clipped(self._smoother.step(dt).position, self.limits)
        self._braking = self._braking and self._smoother.moving
        if self._request is None and self._planner.ready:
            request = self._smoother.request()
            if request is not None:
                self._request = request
                self._asked_at = self._now
                self._planner.ask(request, self._answered)

    def _duration(self, point: Point) -> float | None:
        if point.duration > 0.0:
            return point.duration
        if not 0.0 < point.velocity < 1.0:
            return None
        origin = self._position if self._goal is None else self._goal
        way = float(np.max(np.abs(point.target - origin) / self.limits.velocity))
        return way / point.velocity or None

    def _answered(self, plan: Plan | None) -> None:
        request, self._request = self._request, None
        forgotten, self._forgotten = self._forgotten, False
        used = not forgotten and self._smoother.take(plan)
        late = plan is not None and not used and not forgotten
        self._timing.late_plans += late
        self._latency.took(self._now - self._asked_at, late)
        self._smoother.latency = self._latency.value
        at_rest = request is not None and request.start is None
        self._in_vain = self._in_vain + 1 if plan is None and at_rest and not forgotten else 0
        if self._in_vain >= ATTEMPTS:
            self._in_vain = 0
            self._failed(f'no way was found in {ATTEMPTS} attempts')
