# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The planner: from a request to a plan, without any state, so that it can run anywhere.

A plan is a path and a timing on it that is verified against every limit and ends at rest. Requests
and plans can be pickled: the simulated controller plans in a process of its own.
"""

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother import filtered, optimal, pause, ruckig_move
from epson_driver.motion.smoother.effort import MAX_EFFORT_AT_REST_US, OUTSET_US, Effort
from epson_driver.motion.smoother.path import Knots, Path, through
from epson_driver.motion.smoother.problem import UNBOUND_SPEED, Problem
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.smoother.time_parametrisation import State, TimeParametrisation

CATCH_UP_RATIO, MAX_CATCH_UP_RATIO, CATCH_UP_BISECTIONS = 1.25, 6.0, 4
"""How much faster than commanded the motion may be to make up for lost time; at most, where it
would reach the trajectory's end too late so; and how closely that ratio is looked for."""

LATE_END_SHARE = 0.05
"""What is too late, of the time that is left for the way there."""

GUESS_EXCESS_SHARE = 0.4
"""About how much longer than a plan the guess for it takes, in A/J."""

FULL_CATCH_UP_DELAY_S = 0.05
"""A delay (s) from which on this is used in full."""

STRAIGHT_SHARE, URGENT_SHARE, BRANCH_SHARE, PART_SHARE = 0.1, 0.15, 0.9, 0.8
FRESH_SHARE, FRESH_SHARE_AT_REST = 0.7, 0.55
"""Of the effort that is left: for the straight way from rest; to take any plan when it is urgent;
for each branch of the plan so far; for each part of the path. And for a plan as if there were none
so far."""

SHORTER_SHARES, SHORTER_AFTER = (0.6, 0.4), 1
"""Parts of the path to plan for where there is no plan for all of it; after which branch."""

OPTIMAL, BRANCH = 'optimal', 'branch'
"""Names of what finds plans."""

BRANCHES = ((1, 0.15, True), (0, 0.4, True), (0, 0.15, True), (0, 0.75, True))
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


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """What to plan: from a state on a path through knots that are kept, on through points.

    start: when the plan begins, s on the smoother's clock; None if the arm rests until it comes.
    state: u and its derivatives then. kept: the knots that stay, from the one before the state;
    a single one if the path begins here, at rest. older: more of the knots of the path so far, in
    case that no plan is found with fewer. points: positions after the kept knots, shape (m, n).
    clock: when each kept knot and point should be reached, shape (k + m,), s from any time on.
    timed: whether clock counts for the segment before it, shape (k + m,). lag: how late the state
    is on this clock, s. scale: of all speeds, 0 to come to rest on the path. horizon: how far
    ahead a plan looks at most (nearly), s. urgent: whether a slow plan is better than none.
    former: what the plan so far does from the state on, with all of its knots in `older`.
    whole: whether the trajectory ends at the last of the points.
    reached: how many of the kept knots and points that plan goes to.
    failures: for how many requests in a row, just before, no plan was found.
    """

    start: float | None
    state: State
    kept: Knots
    older: Knots | None
    points: Array
    clock: Array
    timed: npt.NDArray[np.bool_]
    lag: float
    scale: float
    horizon: float
    urgent: bool
    former: TimeParametrisation | None = None
    whole: bool = False
    reached: int = 0
    failures: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """What to do from `start` on (see Request): the path through knots, by the timing.

    The knots are the first ones of the request's kept knots and points.
    proposer: which one found the timing.
    """

    start: float | None
    knots: Knots
    timing: TimeParametrisation
    proposer: str


def plan(request: Request, limits: JointLimits) -> Plan | None:
    """Return a verified plan, or None if none was found (the plan so far goes on then)."""
    first = _path(request, request.kept, limits)
    effort = Effort()
    if request.scale == 0.0:
        for path in _paths(request, first, limits):
            timing = pause.propose(_problem(request, path, limits, 1.0, effort))
            if timing is not None:
                return Plan(request.start, path.knots, timing, 'stop')
        return None
    straight = None
    if len(request.kept.u) == 1:
        effort = Effort(MAX_EFFORT_AT_REST_US)
        straight = effort.part(STRAIGHT_SHARE)
    urgent = effort.part(URGENT_SHARE) if request.urgent else Effort(0)
    found = _optimal(request, first, limits, effort)
    if found is None and request.urgent:
        urgent.back(effort)  # what is left of it, or was used too much
        found = _any(request, first, limits, urgent)
    if found is None and straight is not None:
        found = _straight(request, limits, straight)
    return found


def _optimal(request: Request, first: Path, limits: JointLimits, effort: Effort) -> Plan | None:
    """Return a plan by the optimal proposer: the better ones are tried first."""
    if request.failures % 2 == 0:  # else that has just failed, and the rest has all of the effort
        moving = request.state[1] > 0.0
        fresh = effort.part(FRESH_SHARE if moving else FRESH_SHARE_AT_REST)
        path, problem, bounds = _within_horizon(request, first, limits, fresh)
        timing = None
        if not _leaves_range(path, request.state[0], limits):
            timing = optimal.propose(problem, bounds)
        if timing is not None:
            return Plan(request.start, path.knots, timing, OPTIMAL)
        effort.back(fresh)
    branches = TIMED_BRANCHES if request.timed.any() else BRANCHES
    for number, (dropped, share, timed) in enumerate(branches):
        found = _branch(request, dropped, share, timed, limits, effort)
        if found is None and number == SHORTER_AFTER:
            found = _shorter(request, first, limits, effort)
        if found is not None:
            return found
    if effort.used_up:
        return None
    path, problem, bounds = _within_horizon(request, first, limits, effort)
    timing = None
    if not _leaves_range(path, request.state[0], limits):
        timing = optimal.propose(problem, bounds, optimal.SHORT_RAMP_TIME_S)
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
        lag=request.lag + begin - float(clock[1] - clock[0]) / request.scale,
        horizon=BRANCH_HORIZON_SHARE * request.horizon,
    )
    part = effort.part(BRANCH_SHARE)
    path, problem, bounds = _within_horizon(later, path, limits, part)
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
        part, problem, bounds = _within_horizon(request, path, limits, effort)
        for proposer, share in URGENT:
            mine = effort.part(share)
            timing = proposer(dataclasses.replace(problem, effort=mine), bounds)
            effort.back(mine)
            if timing is not None:
                name = proposer.__module__.rpartition('.')[2]
                return Plan(request.start, part.knots, timing, name)
    return None


def _straight(request: Request, limits: JointLimits, effort: Effort) -> Plan | None:
    """Return a plan from rest straight to rest at the next point: there always is one."""
    path = through(request.kept, request.points[:1], limits, clamped=False)
    problem = _problem(request, path, limits, 1.0, effort)
    timing = ruckig_move.propose(problem, SpeedBounds(problem))
    return None if timing is None else Plan(request.start, path.knots, timing, 'straight')


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
    for share in SHORTER_SHARES:
        count = int(path.knots.u.searchsorted(begin + share * (path.end - begin), side='right'))
        if count <= max(request.reached, 2) or count == len(path.knots.u) or effort.used_up:
            continue
        part = Path(path.knots[:count])
        if _leaves_range(part, begin, limits):
            continue
        mine = effort.part(PART_SHARE)
        mine.spend(OUTSET_US / 2.0)
        problem = _problem(request, part, limits, 1.0, mine)
        timing = optimal.propose(problem, SpeedBounds(problem), tolerance=BRANCH_TOLERANCE)
        effort.back(mine)
        if timing is not None:
            return Plan(request.start, part.knots, timing, OPTIMAL)
    return None


def _within_horizon(
    request: Request, path: Path, limits: JointLimits, effort: Effort
) -> tuple[Path, Problem, SpeedBounds]:
    """Return the path as far as it is looked at now, and the problem on it."""
    effort.spend(OUTSET_US)
    problem = _problem(request, path, limits, CATCH_UP_RATIO, effort)
    bounds = SpeedBounds(problem)
    profile = bounds.profile(problem.start[0], problem.start[1])
    cut = False
    if profile.times[-1] > request.horizon:
        reach = np.interp(0.8 * request.horizon, profile.times, profile.positions)
        count = max(int(path.knots.u.searchsorted(reach)) + 1, len(request.kept.u), 2)
        cut = count < len(path.knots.u)
        path = Path(path.knots[:count])
    if request.timed.any():
        if cut:
            problem = _problem(request, path, limits, CATCH_UP_RATIO, effort)
            bounds = SpeedBounds(problem)
        guess = filtered.filtered(problem, bounds)
        factor = _catch_up(request, path, limits, guess)
        if request.whole and not cut and _late_end(request, path, limits, guess):
            factor = np.full_like(factor, _higher_ratio(request, path, limits, effort))
        problem = _problem(request, path, limits, factor, effort)
        bounds = SpeedBounds(problem)
    elif cut:
        problem = _problem(request, path, limits, 1.0, effort)
        bounds = SpeedBounds(problem)
    return path, problem, bounds


def _late_end(
    request: Request, path: Path, limits: JointLimits, guess: TimeParametrisation | None
) -> bool:
    """Return whether a plan like a guess reaches the end of the path too late."""
    if guess is None:
        return True
    now, end = np.interp([request.state[0], path.end], path.knots.u, request.clock)
    left = float(end - now) / (request.scale or 1.0)
    faster = GUESS_EXCESS_SHARE * float(np.max(limits.acceleration / limits.jerk))
    return request.lag + guess.duration - faster - left > LATE_END_SHARE * left


def _higher_ratio(request: Request, path: Path, limits: JointLimits, effort: Effort) -> float:
    """Return the factor on the commanded speed that is needed to be in time at the end."""
    low, high = CATCH_UP_RATIO, MAX_CATCH_UP_RATIO
    for _ in range(CATCH_UP_BISECTIONS):
        effort.spend(OUTSET_US / 2.0)
        ratio = float(np.sqrt(low * high))
        problem = _problem(request, path, limits, ratio, effort)
        guess = filtered.filtered(problem, SpeedBounds(problem))
        if _late_end(request, path, limits, guess):
            low = ratio
        else:
            high = ratio
    return high


def _catch_up(
    request: Request, path: Path, limits: JointLimits, guess: TimeParametrisation | None
) -> Array:
    """Return the factor on the commanded speed at each knot that makes up for lost time."""
    knots = path.knots.u
    late = np.full(len(knots), request.lag)
    if request.lag < 0.0:
        # too early: slower until that is given back
        clock = request.clock[: len(knots)]
        now = float(np.interp(request.state[0], knots, clock))
        late[clock - now > -request.lag / (CATCH_UP_RATIO - 1.0)] = 0.0
    elif guess is not None:
        # faster until the guess, which is faster all the way, is in time
        ahead = knots > request.state[0]
        clock = request.clock[: len(knots)]
        now = float(np.interp(request.state[0], knots, clock))
        arrival = np.interp(knots[ahead], guess.positions, guess.times)
        # on the way there is only the half of it that comes from the start
        arrival -= GUESS_EXCESS_SHARE / 2.0 * float(np.max(limits.acceleration / limits.jerk))
        late[ahead] += arrival - (clock[ahead] - now) / (request.scale or 1.0)
        late[np.logical_or.accumulate(ahead & (late <= 0.0))] = 0.0
        late[~ahead] = np.maximum(late[~ahead], late[ahead][:1])
    spare = float(request.clock[-1]) - float(
        np.interp(request.state[0], knots, request.clock[: len(knots)])
    )
    # with less known than a stop takes, the time that was lost would be lost again in a stop
    share = np.clip((spare / stopping_time(limits) - 1.0) / 0.5, 0.0, 1.0)
    return 1.0 + np.clip(late / FULL_CATCH_UP_DELAY_S, -1.0, share) * (CATCH_UP_RATIO - 1.0)


def stopping_time(limits: JointLimits) -> float:
    """Return about how long a stop from full speed takes, s: V/A + A/J of the slowest joint."""
    slowing = np.max(limits.velocity / limits.acceleration)
    return float(slowing + np.max(limits.acceleration / limits.jerk))


def _problem(
    request: Request, path: Path, limits: JointLimits, factor: Array | float, effort: Effort
) -> Problem:
    scale = request.scale or 1.0
    speeds = _commanded_speeds(request, path) * factor * scale
    slowing: TimeParametrisation | None = None
    if request.state[1] > 0.0 and (request.timed.any() or scale < 1.0):
        slowing = ruckig_move.gentle_stop(request.state, path, limits)
    return Problem(path, request.state, limits, speeds, scale, slowing, effort, request.former)


def _commanded_speeds(request: Request, path: Path) -> Array:
    """Return u̇ at the knots as the clock commands it, or UNBOUND_SPEED, shape (k,)."""
    u = path.knots.u
    speeds = np.full(len(u), UNBOUND_SPEED)
    steps = np.diff(request.clock[: len(u)])
    timed = request.timed[1 : len(u)] & (steps > 0.0)
    if not timed.any():
        return speeds
    mean = np.full(len(steps), UNBOUND_SPEED)
    mean[timed] = np.diff(u)[timed] / steps[timed]
    # at a knot, as a parabola through it and its neighbours would have it
    inner = (mean[:-1] * steps[1:] + mean[1:] * steps[:-1]) / (steps[:-1] + steps[1:])
    speeds[1:-1] = np.where(timed[:-1] & timed[1:], inner, np.minimum(mean[:-1], mean[1:]))
    speeds[0] = max(2.0 * mean[0] - speeds[1], mean[0]) if timed[0] else UNBOUND_SPEED
    speeds[-1] = max(2.0 * mean[-1] - speeds[-2], mean[-1]) if timed[-1] else UNBOUND_SPEED
    return speeds
