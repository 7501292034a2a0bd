# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a request's clock asks for: the speeds that keep it, and how lost time is made up for."""

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother import filtered, ruckig_move
from epson_driver.motion.smoother.effort import OUTSET_US, Effort
from epson_driver.motion.smoother.path import Path
from epson_driver.motion.smoother.problem import Problem
from epson_driver.motion.smoother.request import Request
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation

UNBOUND_SPEED = 1e6
"""Where no time is commanded: a speed that no limit of a joint allows."""

CATCH_UP_RATIO, MAX_CATCH_UP_RATIO, CATCH_UP_BISECTIONS = 1.25, 6.0, 4
"""How much faster than commanded the motion may be to make up for lost time; at most, where it
would reach the trajectory's end too late so; and how closely that ratio is looked for."""

LATE_END_SHARE = 0.02
"""What is too late, of the time that is left for the way there."""

GUESS_EXCESS_SHARE = 0.4
"""About how much longer than a plan the guess for it takes, in A/J."""

FULL_CATCH_UP_DELAY_S, MAX_DELAY_RATIO = 0.05, 2.4
"""A delay (s) from which on this is used in full; up to so many times of it, in proportion, where
the delay is longer: what is late by more than a little has stood or crawled."""

HORIZON_SHARE = 0.8
"""The path is cut where the speed profile, which is faster than any plan, is after this share of
the horizon."""


def within_horizon(
    request: Request, path: Path, limits: JointLimits, effort: Effort
) -> tuple[Path, Problem, SpeedBounds]:
    """Return the path as far as it is looked at now, and the problem on it."""
    effort.spend(OUTSET_US)
    problem = problem_of(request, path, limits, CATCH_UP_RATIO, effort)
    bounds = SpeedBounds(problem)
    profile = bounds.profile(problem.start[0], problem.start[1])
    cut = False
    if profile.times[-1] > request.horizon:
        reach = np.interp(HORIZON_SHARE * request.horizon, profile.times, profile.positions)
        count = max(int(path.knots.u.searchsorted(reach)) + 1, len(request.kept.u), 2)
        cut = count < len(path.knots.u)
        path = Path(path.knots[:count])
    if request.timed.any():
        if cut:
            problem = problem_of(request, path, limits, CATCH_UP_RATIO, effort)
            bounds = SpeedBounds(problem)
        guess = filtered.filtered(problem, bounds)
        factor = _catch_up(request, path, limits, guess)
        if request.whole and not cut and _late_end(request, path, limits, guess):
            factor = np.full_like(factor, _higher_ratio(request, path, limits, effort))
        problem = problem_of(request, path, limits, factor, effort)
        bounds = SpeedBounds(problem)
    elif cut:
        problem = problem_of(request, path, limits, 1.0, effort)
        bounds = SpeedBounds(problem)
    return path, problem, bounds


def _late_end(
    request: Request, path: Path, limits: JointLimits, guess: TimeParametrisation | None
) -> bool:
    """Return whether a plan like a guess reaches the end of the path too late."""
    if guess is None:
        return True
    now, end = np.interp([request.state[0], path.end], path.knots.u, request.clock)
    left = float(end - now)
    faster = GUESS_EXCESS_SHARE * float(np.max(limits.acceleration / limits.jerk))
    return request.lag + guess.duration - faster - left > LATE_END_SHARE * left


def _higher_ratio(request: Request, path: Path, limits: JointLimits, effort: Effort) -> float:
    """Return the factor on the commanded speed that is needed to be in time at the end."""
    low, high = CATCH_UP_RATIO, MAX_CATCH_UP_RATIO
    for _ in range(CATCH_UP_BISECTIONS):
        effort.spend(OUTSET_US / 2.0)
        ratio = float(np.sqrt(low * high))
        problem = problem_of(request, path, limits, ratio, effort)
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
    clock = request.clock[: len(knots)]
    now = float(np.interp(request.state[0], knots, clock))
    late = np.full(len(knots), max(request.lag, 0.0))
    if guess is not None:
        # faster where the guess, which is faster all the way, is not in time
        ahead = knots > request.state[0]
        arrival = np.interp(knots[ahead], guess.positions, guess.times)
        # on the way there is only the half of it that comes from the start
        arrival -= GUESS_EXCESS_SHARE / 2.0 * float(np.max(limits.acceleration / limits.jerk))
        lost = request.lag + arrival - (clock[ahead] - now)
        late[ahead] = np.maximum(lost, 0.0)
        late[~ahead] = np.maximum(late[~ahead], late[ahead][:1])
    if request.lag < 0.0:
        # too early: slower until that is given back
        early = clock - now <= -request.lag / (CATCH_UP_RATIO - 1.0)
        late[early & (late == 0.0)] = request.lag
    spare = float(request.clock[-1]) - now
    # with less known than a stop takes, the time that was lost would be lost again in a stop
    share = np.clip((spare / stopping_time(limits) - 1.0) / 0.5, 0.0, 1.0)
    share = np.clip(late / FULL_CATCH_UP_DELAY_S, -1.0, MAX_DELAY_RATIO * share)
    return 1.0 + share * (CATCH_UP_RATIO - 1.0)


def stopping_time(limits: JointLimits) -> float:
    """Return about how long a stop from full speed takes, s: V/A + A/J of the slowest joint."""
    slowing = np.max(limits.velocity / limits.acceleration)
    return float(slowing + np.max(limits.acceleration / limits.jerk))


def problem_of(
    request: Request, path: Path, limits: JointLimits, factor: Array | float, effort: Effort
) -> Problem:
    """Return the problem on a path, with so many times the commanded speed (at each knot)."""
    commanded = _commanded(request, path, factor)
    slowing: TimeParametrisation | None = None
    if request.state[1] > 0.0 and request.timed.any():
        slowing = ruckig_move.gentle_stop(request.state, path, limits)
    return Problem(path, request.state, limits, commanded, slowing, effort, request.former)


def _commanded(request: Request, path: Path, factor: Array | float) -> tuple[Array, Array] | None:
    """Return u at the knots and halfway between, and u̇² there as the clock commands it, or None.

    Shape (2 k - 1,). factor: on the speeds; at each knot, shape (k,), or everywhere. The speeds at
    the ends of a segment may be those of short steps beside it, which are far too slow for a long
    one: halfway, the speed is what lets all of it take its commanded time.
    """
    u = path.knots.u
    steps = np.diff(request.clock[: len(u)])
    timed = request.timed[1 : len(u)] & (steps > 0.0)
    if not timed.any():
        return None
    factor = np.broadcast_to(factor, len(u))
    mean = np.full(len(steps), UNBOUND_SPEED)
    mean[timed] = np.diff(u)[timed] / steps[timed]
    speeds = factor * _speeds_at_knots(mean, steps, timed)
    begin, end = speeds[:-1], speeds[1:]
    mean *= (factor[:-1] + factor[1:]) / 2.0
    # with u̇² linear in both halves, each takes its way by the mean of the speeds at its ends
    middle = mean - (begin + end) / 2.0 + np.hypot(mean, (begin - end) / 2.0)
    squares, places = np.empty(2 * len(u) - 1), np.empty(2 * len(u) - 1)
    squares[::2], squares[1::2] = speeds**2, np.maximum(middle**2, (begin**2 + end**2) / 2.0)
    places[::2], places[1::2] = u, (u[:-1] + u[1:]) / 2.0
    return places, squares


def _speeds_at_knots(mean: Array, steps: Array, timed: npt.NDArray[np.bool_]) -> Array:
    """Return u̇ at the knots, shape (k,): UNBOUND_SPEED where no time is commanded.

    mean, steps, timed: of the segments, shape (k - 1,); mean: u̇, UNBOUND_SPEED unless timed.
    """
    speeds = np.full(len(steps) + 1, UNBOUND_SPEED)
    speeds[1:-1] = np.minimum(mean[:-1], mean[1:])
    # at a knot, as a parabola through it and its neighbours would have it
    both = np.flatnonzero(timed[:-1] & timed[1:])
    before, after = steps[both], steps[both + 1]
    speeds[both + 1] = (mean[both] * after + mean[both + 1] * before) / (before + after)
    speeds[0] = max(2.0 * mean[0] - speeds[1], mean[0]) if timed[0] else UNBOUND_SPEED
    speeds[-1] = max(2.0 * mean[-1] - speeds[-2], mean[-1]) if timed[-1] else UNBOUND_SPEED
    return speeds
