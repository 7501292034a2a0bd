# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The planner: from a request to a plan, without any state, so that it can run anywhere.

A plan is a path and a timing on it that is verified against every limit and ends at rest. Requests
and plans can be pickled: the simulated controller plans in a process of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother import filtered, optimal, pause, ruckig_move
from epson_driver.motion.smoother.path import Knots, Path, through
from epson_driver.motion.smoother.problem import UNBOUND_SPEED, Problem
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.smoother.time_parametrisation import State, TimeParametrisation

CATCH_UP_RATIO = 1.25
"""How much faster than commanded the motion may be to make up for lost time."""

FULL_CATCH_UP_DELAY_S = 0.05
"""A delay (s) from which on this is used in full."""


Proposer = Callable[[Problem, SpeedBounds], TimeParametrisation | None]

LADDERS: tuple[tuple[Proposer, ...], ...] = (
    (optimal.propose,),
    (filtered.propose, ruckig_move.propose),
)
"""Proposers in the order in which they are asked; the second row only when it is urgent."""


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
    for ladder in LADDERS if request.urgent else LADDERS[:1]:
        for kept in (request.kept, request.older):
            if kept is not None:
                found = _plan(request, kept, limits, ladder)
                if found is not None:
                    return found
    if len(request.kept.u) == 1 and request.scale > 0.0:
        return _straight(request, limits)
    return None


def _straight(request: Request, limits: JointLimits) -> Plan | None:
    """Return a plan from rest straight to rest at the next point: there always is one."""
    path = through(request.kept, request.points[:1], limits, clamped=False)
    problem = _problem(request, path, limits, 1.0)
    timing = ruckig_move.propose(problem, SpeedBounds(problem))
    return None if timing is None else Plan(request.start, path.knots, timing, 'straight')


def _plan(
    request: Request, kept: Knots, limits: JointLimits, ladder: tuple[Proposer, ...]
) -> Plan | None:
    points = request.points[len(kept.u) - len(request.kept.u) :]
    path = Path(kept)
    if len(points):
        path = through(kept, points, limits, clamped=len(kept.u) > 1)
    if request.scale == 0.0:
        timing = pause.propose(_problem(request, path, limits, 1.0))
        return None if timing is None else Plan(request.start, path.knots, timing, 'stop')
    path, problem, bounds = _within_horizon(request, path, limits)
    for proposer in ladder:
        timing = proposer(problem, bounds)
        if timing is not None:
            return Plan(request.start, path.knots, timing, proposer.__module__.rpartition('.')[2])
    return None


def _within_horizon(
    request: Request, path: Path, limits: JointLimits
) -> tuple[Path, Problem, SpeedBounds]:
    """Return the path as far as it is looked at now, and the problem on it."""
    problem = _problem(request, path, limits, CATCH_UP_RATIO)
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
            problem = _problem(request, path, limits, CATCH_UP_RATIO)
            bounds = SpeedBounds(problem)
        factor = _catch_up(request, path, limits, filtered.filtered(problem, bounds))
        problem = _problem(request, path, limits, factor)
        bounds = SpeedBounds(problem)
    elif cut:
        problem = _problem(request, path, limits, 1.0)
        bounds = SpeedBounds(problem)
    return path, problem, bounds


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
        ahead = knots >= request.state[0]
        clock = request.clock[: len(knots)]
        now = float(np.interp(request.state[0], knots, clock))
        arrival = np.interp(knots[ahead], guess.positions, guess.times)
        late[ahead] += arrival - (clock[ahead] - now) / (request.scale or 1.0)
        late[np.logical_or.accumulate(ahead & (late <= 0.0))] = 0.0
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


def _problem(request: Request, path: Path, limits: JointLimits, factor: Array | float) -> Problem:
    scale = request.scale or 1.0
    speeds = _commanded_speeds(request, path) * factor * scale
    slowing: TimeParametrisation | None = None
    if request.state[1] > 0.0 and (request.timed.any() or scale < 1.0):
        slowing = ruckig_move.gentle_stop(request.state, path, limits)
    return Problem(path, request.state, limits, speeds, scale, slowing)


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
