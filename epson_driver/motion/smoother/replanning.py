# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Decides when to replan, builds the request, and applies the planner's plan."""

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from epson_driver.motion.limits import JointLimits
from epson_driver.motion.smoother.commanded_times import stopping_time
from epson_driver.motion.smoother.execution import Execution
from epson_driver.motion.smoother.path import Knots, Path
from epson_driver.motion.smoother.request import ActivePlan, Plan, Request
from epson_driver.motion.smoother.waypoints import Waypoint, Waypoints
from epson_driver.motion.time_parametrisation import TimeParametrisation

START_DELAY_S = 0.02
"""Delay before a short motion starts from rest, s. More points may arrive during this time."""

MAX_START_DELAY_S = 0.1
"""Maximum delay of a start, s, if the points have times and the arm would stop before the next
plan."""

MIN_PERIOD_S = 0.03
"""Minimum time between two plans."""

MIN_POINTS = 3

MIN_OVER_POINTS, OVER_S, OVER_RATIO = 3, 0.01, 1.5
"""A trajectory is probably over if enough points are ahead, and none has arrived for OVER_S and
OVER_RATIO times the longest interval: before the motion between the arrivals of points, and later
between their commanded times. Messages do not mark the end of a trajectory."""

RESERVE_IN_STOPPING_TIMES = 2.5
"""Duration of the reserve, in stopping times. It is the last part of a plan, during which the plan
may be replaced."""

URGENT_RESERVE_SHARE = 0.4
"""A plan with a slow motion is accepted in this last fraction of the reserve only."""

LATE_TOLERANCE_S = 1e-9
"""Maximum time by which a plan may start in the past because of rounding."""

Planner = Callable[[Request, JointLimits], Plan | None]
"""Function that returns a verified plan, or None if none was found."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class PendingRequest:
    """A request whose plan is awaited. more: whether waypoints before a rest are left out."""

    request: Request
    route: list[Waypoint]
    more: bool


class Replanning:
    """Replaces the executed plan by a better one before the executed plan ends at rest.

    With a `planner`, `plan_now` plans. Without a planner, the caller plans each `request` and
    passes the plan to `take`. At most one request is pending. A plan starts `latency` s after its
    request.
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
        """Whether a new plan may be better than the last plan, e.g. because of new points."""
        self._end_known = False
        """Whether the last request contained the probable end of the trajectory."""
        self.planner_errors = 0
        self.planner_error: Exception | None = None
        self._reserve = RESERVE_IN_STOPPING_TIMES * stopping_time(waypoints.limits)
        self._pending: PendingRequest | None = None
        self._request_time = -np.inf

    def forget(self) -> None:
        self._pending = self._execution.next = None
        self.news = False

    def start_over(self) -> None:
        self.forget()
        self.news = True
        self._reserve = RESERVE_IN_STOPPING_TIMES * stopping_time(self._waypoints.limits)

    def plan_now(self) -> None:
        if self._planner is not None:
            request = self.request()
            if request is not None:
                self.take(self._planned(self._planner, request))

    def request(self) -> Request | None:
        pending = self._pending is not None or self._execution.next is not None
        if pending or not self._should_plan():
            return None
        self._pending = self._new_request()
        self._request_time = self._execution.now
        self.news = False
        return self._pending.request

    def take(self, answer: Plan | None) -> bool:
        """Accept the plan for the last request. Return whether the plan is used.

        answer: the plan, or None if the planner found none. A plan that is too late is not used.
        """
        execution = self._execution
        pending, self._pending = self._pending, None
        if pending is None:
            return False  # the request has been discarded
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
            answer.in_time,
        )
        short = count < len(pending.route) or answer.timing.end < answer.knots.u[-1]
        self.news = self.news or pending.more or short
        return True

    def _planned(self, planner: Planner, request: Request) -> Plan | None:
        try:
            return planner(request, self._waypoints.limits)
        except Exception as error:
            self.planner_errors += 1
            if repr(error) != repr(self.planner_error):  # log a repeated failure only once
                log.exception('the planner failed, so the current plan continues')
            self.planner_error = error
            return None

    def _should_plan(self) -> bool:
        execution = self._execution
        if execution.stopping:
            return False
        plan = execution.plan
        if plan is None:
            return self._should_start()
        if execution.now < self._request_time + MIN_PERIOD_S:
            return False
        if plan.pause != execution.held:
            return True
        news = self.news or (not self._end_known and self._over())
        if plan.pause or plan.finished or not news:
            return False
        return 0.0 < plan.end - execution.now - self.latency < self._reserve

    def _should_start(self) -> bool:
        execution, waypoints = self._execution, self._waypoints
        now = execution.now
        if execution.held or now < waypoints.rest_until:
            return False
        waited = now - waypoints.waiting_since()
        waited_enough = waited >= START_DELAY_S
        if not waypoints.ahead:
            if not waited_enough or not execution.near_last:
                return False
            waypoints.return_to_origin(now)
        known = waypoints.time_from_rest(now)
        if waypoints.last.rest is not None or known > self._reserve / 2.0:
            return True
        if not waited_enough or waited >= MAX_START_DELAY_S:
            return waited_enough
        # a motion that ends before the next plan would stop between points
        followed = known >= self.latency + MIN_PERIOD_S or not waypoints.last.timed
        return followed or now >= waypoints.last.arrival + START_DELAY_S

    def _new_request(self) -> PendingRequest:
        execution, waypoints = self._execution, self._waypoints
        horizon = 2.0 * self._reserve
        plan = execution.plan
        start: float | None = None
        current_knots: Knots | None = None
        current_timing: TimeParametrisation | None = None
        lag = 0.0
        urgent = True
        pause = plan is not None and execution.held
        if plan is None:
            position = execution.motion.position
            zeros = np.zeros((1, len(position)))
            start_knots = Knots(np.zeros(1), position[None, :], zeros, zeros)
            route = [waypoints.origin]
            state = (0.0, 0.0, 0.0)
        else:
            branch = execution.now + self.latency
            if not execution.paused:
                start = branch
                urgent = plan.end - branch < URGENT_RESERVE_SHARE * self._reserve
            state = plan.timing.at(branch - plan.start)
            current_timing = plan.timing.part(branch - plan.start)
            knots = plan.path.knots
            first = plan.path.segment(state[0])
            start_knots, route = knots[first : first + 2], plan.route[first : first + 2]
            current_knots = knots[first:]
            if execution.clock_start is not None and route[-1].timed:
                lag = branch - execution.clock_start - plan.clock(branch)
            else:
                execution.clock_start = None
        known = len(route)
        reached = route[0].clock if plan is None else plan.clock(branch)
        more = self._extend(route, reached + horizon)
        if current_knots is not None and len(current_knots.u) > len(route):
            # the current plan includes points beyond this request
            current_knots = current_timing = None
        points = [point.position for point in route[known:]]
        clocks = np.array([point.clock for point in route])
        clocks[0] += route[0].rest or 0.0  # the rest at the first waypoint is over
        request = Request(
            start,
            state,
            start_knots,
            current_knots,
            np.array(points).reshape(len(points), start_knots.position.shape[1]),
            clocks,
            np.array([point.timed for point in route]),
            lag,
            pause,
            horizon,
            urgent,
            current_timing,
            route[-1].rest is not None,
            self._catch_up,
            plan is not None and plan.in_time,
            route[-1].rest is not None or (not more and self._over()),
        )
        self._end_known = request.ends
        return PendingRequest(request, route, more)

    def _over(self) -> bool:
        """Return whether the points ahead are probably all that remains of a trajectory."""
        ahead = self._waypoints.ahead
        if len(ahead) < MIN_OVER_POINTS:
            return False
        # a sender that has filled a buffer waits until the arm has passed a point
        moving = self._execution.plan is not None
        times = [point.clock if moving else point.arrival for point in ahead]
        pause = OVER_S + OVER_RATIO * max(np.diff(times))
        return bool(self._execution.now - ahead[-1].arrival >= pause)

    def _extend(self, route: list[Waypoint], end: float) -> bool:
        """Add waypoints up to the next rest to the route. Return whether some are left out.

        end: time, s. A waypoint with a later commanded time is added only if fewer than MIN_POINTS
        have been added.
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
