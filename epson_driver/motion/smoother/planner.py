# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The planner: from a request to a plan, without any state, so that it can run anywhere.

A plan is a path and a timing on it that is verified against every limit and ends at rest. The
simulated controller plans in a process of its own.
"""

import dataclasses
from itertools import pairwise

import numpy as np

from epson_driver.motion.limits import JointLimits
from epson_driver.motion.point_to_point import go
from epson_driver.motion.smoother import optimal, pause, ruckig_move
from epson_driver.motion.smoother.commanded_times import problem_of, within_horizon
from epson_driver.motion.smoother.effort import Effort
from epson_driver.motion.smoother.path import Knots, Path, line, through
from epson_driver.motion.smoother.request import Plan, Request

URGENT_SHARE, FRESH_SHARE, BRANCH_SHARE = 0.15, 0.7, 0.9
"""Of the effort that is left: to take any plan when it is urgent; for a plan as if there were none
so far; for each branch of that."""

CRAWL_RATIO = 1.5
"""A plan from rest that takes so many times as long as stops at all points is not taken."""

OPTIMAL, BRANCH = 'optimal', 'branch'
"""Names of what finds plans."""

BRANCH_SHARES = (0.15, 0.4, 0.75)
"""Where to leave the plan so far, in shares of its time."""

BRANCH_HORIZON_SHARE = 0.6
"""How far a plan that leaves the plan so far looks ahead then."""

BRANCH_TOLERANCE = 1e-2
"""How much more time such a plan may take than the best one, relative."""


def plan(request: Request, limits: JointLimits) -> Plan | None:
    """Return a verified plan, or None if none was found (the plan so far goes on then)."""
    first = _path(request, request.kept, limits)
    effort = Effort()
    if request.pause:
        path = first if request.older is None else Path(request.older)
        timing = pause.propose(problem_of(request, path, limits, 1.0, effort))
        return None if timing is None else Plan(request.start, path.knots, timing, 'stop')
    at_rest = len(request.kept.u) == 1
    if at_rest and len(request.points) == 1 and request.whole and not request.timed.any():
        # from one rest to the next there is one way, which nothing will go on from
        found = _straight(request, limits)
        if found is not None:
            return found
    urgent = effort.part(URGENT_SHARE) if request.urgent else Effort(0)
    found = None
    if request.failures % 2 == 0:  # else that has just failed, and the rest has all of the effort
        found = _fresh(request, first, limits, effort, 1.0 if at_rest else FRESH_SHARE)
    for share in () if at_rest else BRANCH_SHARES:
        if found is None:
            found = _branch(request, share, limits, effort)
    if found is None and not effort.used_up:
        found = _fresh(request, first, limits, effort, 1.0, optimal.SHORT_RAMP_TIME_S)
    if at_rest and found is not None and _crawls(request, found, limits):
        found = None
    if found is None and request.urgent:
        urgent.back(effort)  # what is left of it, or was used too much
        found = _simple(request, first, limits, urgent)
        if at_rest and (found is None or _crawls(request, found, limits)):
            return _straight(request, limits)
    return found


def _crawls(request: Request, plan_: Plan, limits: JointLimits) -> bool:
    """Return whether a plan from rest crawls: it takes much longer than to stop at each point.

    A sharp bend may slow all of the path down to its own pace. Commanded time is no crawl.
    """
    path, timing = Path(plan_.knots), plan_.timing
    if len(path.knots.u) == 2:
        return False  # it has no bend
    left = timing.duration / CRAWL_RATIO
    if request.timed.any():
        clock = np.interp([0.0, timing.end], path.knots.u, request.clock[: len(path.knots.u)])
        if left <= clock[1] - clock[0]:
            return False
    ways = np.vstack([path.knots.position[path.knots.u < timing.end], path.at(timing.end)[0]])
    # a path on the border of the range is beside it by rounding
    for start, target in pairwise(np.clip(ways, limits.position_min, limits.position_max)):
        left -= go(limits, start, target).duration
        if left <= 0.0:
            return False
    return True


def _fresh(
    request: Request,
    first: Path,
    limits: JointLimits,
    effort: Effort,
    share: float,
    ramp_time: float = optimal.MAX_RAMP_TIME_S,
) -> Plan | None:
    """Return a plan as if there were none so far, by a share of the effort that is left."""
    fresh = effort.part(share)
    path, problem, bounds = within_horizon(request, first, limits, fresh)
    timing = None
    if not _leaves_range(path, request.state[0], limits):
        timing = optimal.propose(problem, bounds, ramp_time)
    effort.back(fresh)
    return None if timing is None else Plan(request.start, path.knots, timing, OPTIMAL)


def _branch(request: Request, share: float, limits: JointLimits, effort: Effort) -> Plan | None:
    """Return a plan that does as the plan so far for a share of its time, and then goes on.

    A motion that uses its limits to the full may have no other way on for a while: there is more
    freedom where it has begun to brake for its end.
    """
    former, older = request.former, request.older
    if former is None or older is None or effort.used_up:
        return None
    begin = share * former.duration
    state = former.at(begin)
    head = former.part(0.0, begin)
    if head is None or state[0] >= older.u[-1]:
        return None
    path = _path(request, older, limits)
    clock = np.interp([request.state[0], state[0]], path.knots.u, request.clock)
    later = dataclasses.replace(
        request,
        state=state,
        former=former.part(begin),
        lag=request.lag + begin - float(clock[1] - clock[0]),
        horizon=BRANCH_HORIZON_SHARE * request.horizon,
    )
    part = effort.part(BRANCH_SHARE)
    path, problem, bounds = within_horizon(later, path, limits, part)
    timing = None
    if not _leaves_range(path, state[0], limits):
        timing = optimal.propose(problem, bounds, tolerance=BRANCH_TOLERANCE)
    if timing is not None:
        timing = head.then(timing)
    if timing is not None and not problem.usage(timing).allowed:
        timing = None
    effort.back(part)
    return None if timing is None else Plan(request.start, path.knots, timing, BRANCH)


def _leaves_range(path: Path, begin: float, limits: JointLimits) -> bool:
    """Return whether a path leaves the position limits from some u on: no timing helps then.

    A knot that is kept may bend towards a border that is too near for what follows.
    """
    return bool(path.outside(limits)[path.segment(begin) :].any())


def _simple(request: Request, first: Path, limits: JointLimits, effort: Effort) -> Plan | None:
    """Return one move along the path, which may be slow, or None."""
    path, problem, _ = within_horizon(request, first, limits, effort)
    timing = ruckig_move.propose(problem)
    return None if timing is None else Plan(request.start, path.knots, timing, 'simple')


def _straight(request: Request, limits: JointLimits) -> Plan | None:
    """Return a plan from rest straight to rest at the next point: there always is one."""
    way = line(request.kept, request.points[0], limits)
    timing = ruckig_move.only_move(problem_of(request, way, limits, 1.0, Effort()))
    return None if timing is None else Plan(request.start, way.knots, timing, 'straight')


def _path(request: Request, kept: Knots, limits: JointLimits) -> Path:
    """Return the path along some of the knots so far, and on through the points."""
    points = request.points[len(kept.u) - len(request.kept.u) :]
    if not len(points):
        return Path(kept)
    return through(kept, points, limits, clamped=len(kept.u) > 1, final=request.whole)
