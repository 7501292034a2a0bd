# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The planner: from a request to a plan, without any state, so that it can run anywhere.

A plan is a path and a timing on it that is verified against every limit and ends at rest. The
simulated controller plans in a process of its own.
"""

import dataclasses
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from epson_driver.motion.limits import JointLimits
from epson_driver.motion.point_to_point import go
from epson_driver.motion.smoother import filtered, optimal, pause, ruckig_move
from epson_driver.motion.smoother.commanded_times import problem_of, within_horizon
from epson_driver.motion.smoother.effort import OUTSET_US, Effort
from epson_driver.motion.smoother.path import Knots, Path, line, through
from epson_driver.motion.smoother.problem import Problem
from epson_driver.motion.smoother.request import Plan, Request
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation

STRAIGHT_SHARE, URGENT_SHARE, FRESH_SHARE, BRANCH_SHARE, PART_SHARE = 0.1, 0.15, 0.7, 0.9, 0.8
"""Of the effort that is left: for the straight way from rest; to take any plan when it is urgent;
for a plan as if there were none so far; for each branch of that; for each part of the path."""

SHORTER_SHARES, SHORTER_AFTER = (0.6, 0.4), 1
"""Parts of the path to plan for where there is no plan for all of it; after which branch."""

SIMPLER_SHARE = 0.5
"""With less of the effort left, what is simpler from rest waits for the next request."""

CRAWL_RATIO = 1.5
"""A plan from rest that takes so many times as long as stops at all points is not taken."""

OPTIMAL, BRANCH = 'optimal', 'branch'
"""Names of what finds plans."""

BRANCHES = ((1, 0.15, True), (0, 0.15, True), (0, 0.4, True), (0, 0.75, True))
TIMED_BRANCHES = (
    (1, 0.15, True),
    (0, 0.15, True),
    (0, 0.15, False),
    (0, 0.4, True),
    (0, 0.4, False),
    (0, 0.75, True),
)
"""Where to leave the plan so far: how many of its last knots are not kept, the share of its time
until then, and whether commanded speeds count: the clock makes up for it if they do not."""

BRANCH_HORIZON_SHARE = 0.6
"""How far a plan that leaves the plan so far looks ahead then."""

BRANCH_TOLERANCE = 1e-2
"""How much more time such a plan may take than the best one, relative."""

SAME_BEND_SHARE = 1e-6
"""Derivatives of two paths that differ relatively by no more than this are the same."""

LEAST_OLDER = 3
"""A path with no more knots than this has none to keep but those that are kept anyway."""

Proposer = Callable[[Problem, SpeedBounds], TimeParametrisation | None]

URGENT: tuple[tuple[Proposer, float], ...] = ((filtered.propose, 0.5), (ruckig_move.propose, 1.0))
"""Proposers that are asked only when it is urgent, and of the effort that is left for each path:
so much is left for the simplest one that it can do something."""


def plan(request: Request, limits: JointLimits) -> Plan | None:
    """Return a verified plan, or None if none was found (the plan so far goes on then)."""
    first = _path(request, request.kept, limits)
    effort = Effort()
    if request.pause:
        for path in _paths(request, first, limits):
            timing = pause.propose(problem_of(request, path, limits, 1.0, effort))
            if timing is not None:
                return Plan(request.start, path.knots, timing, 'stop')
        return None
    at_rest = len(request.kept.u) == 1
    if at_rest and len(request.points) == 1 and request.whole and not request.timed.any():
        # from one rest to the next there is one way, which nothing will go on from
        way = line(request.kept, request.points[0], limits)
        timing = ruckig_move.only_move(problem_of(request, way, limits, 1.0, effort))
        if timing is not None:
            return Plan(request.start, way.knots, timing, 'straight')
    if at_rest and request.failures == 0:
        # no motion runs out of points meanwhile: what is simpler can wait for the next request
        before = effort.left
        found = _fresh(request, first, limits, effort, 1.0)
        if found is not None and not _crawls(request, found, limits):
            return found
        if effort.left < SIMPLER_SHARE * before:
            return None
        request = dataclasses.replace(request, failures=1)
    straight = effort.part(STRAIGHT_SHARE) if at_rest else None
    urgent = effort.part(URGENT_SHARE) if request.urgent else Effort(0)
    found = _optimal(request, first, limits, effort)
    if found is None and request.urgent:
        urgent.back(effort)  # what is left of it, or was used too much
        found = _any(request, first, limits, urgent)
    if found is not None and straight is not None and _crawls(request, found, limits):
        found = None
    if found is None and straight is not None:
        found = _straight(request, limits, straight)
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


def _optimal(request: Request, first: Path, limits: JointLimits, effort: Effort) -> Plan | None:
    """Return a plan by the optimal proposer: the better ones are tried first."""
    if request.failures % 2 == 0:  # else that has just failed, and the rest has all of the effort
        found = _fresh(request, first, limits, effort, FRESH_SHARE)
        if found is not None:
            return found
    branches = TIMED_BRANCHES if request.timed.any() else BRANCHES
    for number, (dropped, share, timed) in enumerate(branches):
        if not timed and (not request.urgent or request.catch_up < np.inf):
            continue  # a motion that goes on as planned is in time
        found = _branch(request, dropped, share, timed, limits, effort)
        if found is None and number == SHORTER_AFTER:
            found = _shorter(request, first, limits, effort)
        if found is not None:
            return found
    if effort.used_up:
        return None
    path, problem, bounds = within_horizon(request, first, limits, effort)
    timing = None
    if not _leaves_range(path, request.state[0], limits):
        timing = optimal.propose(problem, bounds, optimal.SHORT_RAMP_TIME_S)
    return None if timing is None else Plan(request.start, path.knots, timing, OPTIMAL)


def _fresh(
    request: Request, first: Path, limits: JointLimits, effort: Effort, share: float
) -> Plan | None:
    """Return a plan as if there were none so far, by a share of the effort that is left."""
    fresh = effort.part(share)
    path, problem, bounds = within_horizon(request, first, limits, fresh)
    timing = None
    if not _leaves_range(path, request.state[0], limits):
        timing = optimal.propose(problem, bounds)
    effort.back(fresh)
    return None if timing is None else Plan(request.start, path.knots, timing, OPTIMAL)


def _branch(
    request: Request,
    dropped: int,
    share: float,
    timed: bool,
    limits: JointLimits,
    effort: Effort,
) -> Plan | None:
    """Return a plan that does as the plan so far for a share of its time, and then goes on.

    A motion that uses its limits to the full may have no other way on for a while: there is more
    freedom where it has begun to brake for its end.
    """
    former, older = request.former, request.older
    if former is None or older is None or effort.used_up:
        return None
    kept = older[: len(older.u) - dropped]
    begin = share * former.duration
    state = former.at(begin)
    head = former.part(0.0, begin)
    if head is None or len(kept.u) < 2 or state[0] >= kept.u[-1]:
        return None
    path = _path(request, kept, limits)
    clock = np.interp([request.state[0], state[0]], path.knots.u, request.clock)
    later = dataclasses.replace(
        request,
        state=state,
        timed=request.timed & timed,
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


def _any(request: Request, first: Path, limits: JointLimits, effort: Effort) -> Plan | None:
    """Return a plan by one of the other proposers."""
    for path in _paths(request, first, limits):
        part, problem, bounds = within_horizon(request, path, limits, effort)
        for proposer, share in URGENT:
            mine = effort.part(share)
            timing = proposer(dataclasses.replace(problem, effort=mine), bounds)
            effort.back(mine)
            if timing is not None:
                name = proposer.__module__.rpartition('.')[2]
                return Plan(request.start, part.knots, timing, name)
    return None


def _straight(request: Request, limits: JointLimits, effort: Effort) -> Plan | None:
    """Return a plan from rest straight to rest at the next point: there always is one.

    A path that can be gone on from is tried first, as long as there is effort left for it.
    """
    curved = through(request.kept, request.points[:1], limits, clamped=False)
    straight = line(request.kept, request.points[0], limits)
    for path, mine in ((curved, effort), (straight, Effort())):
        problem = problem_of(request, path, limits, 1.0, mine)
        timing = ruckig_move.propose(problem, SpeedBounds(problem))
        if timing is not None:
            return Plan(request.start, path.knots, timing, 'straight')
    return None


def _path(request: Request, kept: Knots, limits: JointLimits) -> Path:
    """Return the path along some of the knots so far, and on through the points."""
    points = request.points[len(kept.u) - len(request.kept.u) :]
    if not len(points):
        return Path(kept)
    return through(kept, points, limits, clamped=len(kept.u) > 1, final=request.whole)


def _paths(request: Request, first: Path, limits: JointLimits) -> Iterator[Path]:
    """Return the first path, and one that keeps all knots so far but the last, if that differs."""
    yield first
    if request.older is not None and len(request.older.u) > LEAST_OLDER:
        second = _path(request, request.older[:-1], limits)
        if not _same(first.knots, second.knots):
            yield second


def _same(one: Knots, other: Knots) -> bool:
    """Return whether two paths through the same points bend in the same way."""
    return np.allclose(one.first, other.first, rtol=SAME_BEND_SHARE) and np.allclose(
        one.second, other.second, rtol=SAME_BEND_SHARE
    )


def _shorter(request: Request, path: Path, limits: JointLimits, effort: Effort) -> Plan | None:
    """Return a plan to a knot before the end of the path, which may bend badly there."""
    begin = request.state[0]
    at_rest = len(request.kept.u) == 1  # there is no plan so far: the shortest is found first
    for share in sorted(SHORTER_SHARES, reverse=not at_rest):
        count = int(path.knots.u.searchsorted(begin + share * (path.end - begin), side='right'))
        if count <= max(request.reached, 2) or count == len(path.knots.u) or effort.used_up:
            continue
        part = Path(path.knots[:count])
        if _leaves_range(part, begin, limits):
            continue
        mine = effort.part(PART_SHARE)
        mine.spend(OUTSET_US / 2.0)
        problem = problem_of(request, part, limits, 1.0, mine)
        timing = optimal.propose(problem, SpeedBounds(problem), tolerance=BRANCH_TOLERANCE)
        effort.back(mine)
        if timing is not None:
            return Plan(request.start, part.knots, timing, OPTIMAL)
    return None
