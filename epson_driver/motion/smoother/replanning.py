# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Decides when to replan, builds the planner's request, and applies its answer."""

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from epson_driver.motion.limits import JointLimits
from epson_driver.motion.smoother.commanded_times import stopping_time
from epson_driver.motion.smoother.execution import Execution
from epson_driver.motion.smoother.path import Knots, Path
from epson_driver.motion.smoother.request import ActivePlan, Plan, Request
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation
from epson_driver.motion.smoother.waypoints import Waypoint, Waypoints

START_PATIENCE_S = 0.03
"""Time for which the first point waits at rest for more, before a short motion starts, s."""

MAX_START_PATIENCE_S = 0.1
"""Maximum wait while timed points arrive whose motion would end before the next plan, s."""

MIN_PERIOD_S = 0.03
"""Minimum time between two plans, s."""

MIN_POINTS = 3
"""Minimum number of points in a plan, if they are known."""

RESERVE_IN_STOPPING_TIMES = 2.5
"""A plan is replaced only if it ends within this time, in multiples of the stopping time."""

URGENT_RESERVE_SHARE = 0.4
"""A plan that ends within this share of the reserve is replaced by any found plan, even a slow
one."""

LATE_TOLERANCE_S = 1e-9
"""Tolerance for a plan that starts slightly in the past, s."""

Planner = Callable[[Request, JointLimits], Plan | None]
"""Returns a verified plan, or None if none was found."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class PendingRequest:
    """A request, the waypoints of its knots, and whether more waypoints follow."""

    request: Request
    route: list[Waypoint]
    more: bool


class Replanning:
    """Replaces the executed plan by a better one before it comes to its rest.

    One request is pending at a time: call `request`, then `take` with the plan. With a `planner`,
    `plan_now` does both. Without one, the caller plans the request. A plan starts `latency` s
    after its request. `planner_errors` counts the planner's exceptions, `planner_error` is the
    last one.
    """

    def __init__(
        self,
        waypoints: Waypoints,
        execution: Execution,
        planner: Planner | None,
        latency: float,
        catch_up: float,
    ) -> None:
        self._waypoints = waypoints
        self._execution = execution
        self._planner = planner
        self.latency = latency
        self._catch_up = catch_up
        self.news = False
        """Whether anything useful to a plan has arrived since the last request."""
        self.planner_errors = 0
        self.planner_error: Exception | None = None
        self._reserve = RESERVE_IN_STOPPING_TIMES * stopping_time(waypoints.limits)
        self._pending: PendingRequest | None = None
        self._asked_at = -np.inf

    def forget(self) -> None:
        """Discard the pending request and the next plan, as their points are discarded."""
        self._pending = self._execution.next = None
        self.news = False

    def start_over(self) -> None:
        """Discard the pending request and the next plan, and replan the points."""
        self.forget()
        self.news = True
        self._reserve = RESERVE_IN_STOPPING_TIMES * stopping_time(self._waypoints.limits)

    def plan_now(self) -> None:
        """Plan if it is time to and a planner exists."""
        if self._planner is not None:
            request = self.request()
            if request is not None:
                self.take(self._planned(self._planner, request))

    def request(self) -> Request | None:
        """Return the next planning request, or None. `take` its plan before the next one."""
        asked = self._pending is not None or self._execution.next is not None
        if asked or not self._worth_planning():
            return None
        self._pending = self._made_request()
        self._asked_at = self._execution.now
        self.news = False
        return self._pending.request

    def take(self, answer: Plan | None) -> bool:
        """Accept the plan for the last request and return whether it is used.

        None, or a plan that comes too late, changes nothing.
        """
        execution = self._execution
        pending, self._pending = self._pending, None
        if pending is None:
            return False  # discarded in the meantime
        now = execution.now
        if answer is None or (answer.start is not None and answer.start < now - LATE_TOLERANCE_S):
            self.news = True
            plan = execution.plan
            if answer is None and execution.paused and not execution.held and plan is not None:
                execution.rest_between(plan, plan.timing.end)
            return False
        first = now if answer.start is None else answer.start
        if answer.start is None and self._planner is not None:
            first += self.latency
        count = len(answer.knots.u)
        execution.next = ActivePlan(
            Path(answer.knots),
            answer.timing,
            pending.route[:count],
            pending.request.clock[:count],
            first,
            pending.request.pause,
        )
        short = count < len(pending.route) or answer.timing.end < answer.knots.u[-1]
        self.news = self.news or pending.more or short
        return True

    def _planned(self, planner: Planner, request: Request) -> Plan | None:
        """Return the planner's plan, or None if it raised. The current plan ends at rest."""
        try:
            return planner(request, self._waypoints.limits)
        except Exception as error:
            self.planner_errors += 1
            if repr(error) != repr(self.planner_error):  # log a repeated failure only once
                log.exception('the planner failed, so the current plan continues')
            self.planner_error = error
            return None

    def _worth_planning(self) -> bool:
        execution = self._execution
        if execution.joint_motion is not None or execution.stopping:
            return False
        plan = execution.plan
        if plan is None:
            return self._worth_beginning()
        if execution.now < self._asked_at + MIN_PERIOD_S:
            return False
        if plan.pause != execution.held:
            return True
        if plan.pause or plan.finished or not self.news:
            return False
        return 0.0 < plan.end - execution.now - self.latency < self._reserve

    def _worth_beginning(self) -> bool:
        """Return whether to leave the rest now."""
        execution, waypoints = self._execution, self._waypoints
        now = execution.now
        if execution.held or now < waypoints.rest_until:
            return False
        waited = now - waypoints.waiting_since()
        patient = waited >= START_PATIENCE_S
        if not waypoints.ahead:
            if not patient or not execution.beside_last:
                return False
            waypoints.go_back(now)
        known = waypoints.time_from_rest(now)
        if waypoints.last.rest is not None or known > self._reserve / 2.0:
            return True
        if not patient or waited >= MAX_START_PATIENCE_S:
            return patient
        # a motion that ends before the next plan can follow would stop between points
        followed = known >= self.latency + MIN_PERIOD_S or not waypoints.last.timed
        return followed or now >= waypoints.last.came + START_PATIENCE_S

    def _made_request(self) -> PendingRequest:
        execution, waypoints = self._execution, self._waypoints
        horizon = 2.0 * self._reserve
        plan = execution.plan
        start: float | None = None
        older: Knots | None = None
        former: TimeParametrisation | None = None
        lag = 0.0
        urgent = True
        pause = plan is not None and execution.held
        if plan is None:
            position = execution.motion.position
            zeros = np.zeros((1, len(position)))
            kept, route = Knots(np.zeros(1), position[None, :], zeros, zeros), [waypoints.origin]
            state = (0.0, 0.0, 0.0)
        else:
            begin = execution.now + self.latency
            if not execution.paused:
                start = begin
                urgent = plan.end - begin < URGENT_RESERVE_SHARE * self._reserve
            state = plan.timing.at(begin - plan.begin)
            former = plan.timing.part(begin - plan.begin)
            knots = plan.path.knots
            first = plan.path.segment(state[0])
            kept, route = knots[first : first + 2], plan.route[first : first + 2]
            older = knots[first:]
            if execution.clock_start is not None and route[-1].timed:
                lag = begin - execution.clock_start - plan.clock(begin)
            else:
                execution.clock_start = None
        known = len(route)
        reached = route[0].clock if plan is None else plan.clock(begin)
        more = self._extend(route, reached + horizon)
        if older is not None and len(older.u) > len(route):
            older = former = None  # the former plan includes points beyond this request
        points = [point.position for point in route[known:]]
        clocks = np.array([point.clock for point in route])
        clocks[0] += route[0].rest or 0.0  # the commanded rest there is over
        request = Request(
            start,
            state,
            kept,
            older,
            np.array(points).reshape(len(points), kept.position.shape[1]),
            clocks,
            np.array([point.timed for point in route]),
            lag,
            pause,
            horizon,
            urgent,
            former,
            route[-1].rest is not None,
            self._catch_up,
        )
        return PendingRequest(request, route, more)

    def _extend(self, route: list[Waypoint], end: float) -> bool:
        """Add waypoints to the route up to the next rest. Return whether more are known.

        end: minimum clock to reach, s.
        """
        waypoints = self._waypoints
        known = len(route)
        if route[-1].rest is not None and route[-1] is not waypoints.origin:
            return False
        for point in waypoints.ahead:
            if point.index <= route[-1].index:
                continue
            enough = len(route) >= known + MIN_POINTS
            if enough and point.clock > end:
                return True
            route.append(point)
            if point.rest is not None:
                break
        return False
