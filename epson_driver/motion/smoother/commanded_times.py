# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a request's clock asks for: the speeds that keep it, late or early as it is."""

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

GUESS_EXCESS_SHARE = 0.4
"""How much longer than a plan the guess for it takes, about, in A/J: half of it at the start."""

CATCH_UP_PER_S, LEAST_RATIO = 5.0, 0.6
"""How much faster than commanded the motion is for each second that it is late, relative, or how
much slower where it is early; and the least, of the commanded speed."""

IN_TIME_S = 0.04
"""So early or late is in time, s: the guess is no better, and to hurry for less would take the
evenness from times that a limited motion of a tool has. A plan that is earlier, or ends later, is
made again."""

LOCAL_RATIO = 1.6
"""So many times as fast as commanded a motion is to be in time on its way; more only to be in time
at its end."""

BISECTIONS = 4
"""How closely the ratio is looked for that is needed for that."""

KNOT_RATIO = 1.5
"""So many times as fast as on the slower of its segments a knot may be passed."""

LEAD_IN_STOPPING_TIMES = 2.0
"""How long before its end a trajectory gets a little ahead of its times."""

HORIZON_SHARE, TIMED_HORIZON_RATIO = 0.8, 1.25
"""The path is cut where the speed profile, which is faster than most plans, is after this share of
the horizon; and how much longer that is at commanded speeds, which are caught up with."""


def within_horizon(
    request: Request,
    path: Path,
    limits: JointLimits,
    effort: Effort,
    found: TimeParametrisation | None = None,
) -> tuple[Path, Problem, SpeedBounds]:
    """Return the path as far as it is looked at now, and the problem on it.

    found: by the problem that was returned before, where that does not keep to the clock.
    """
    effort.spend(OUTSET_US)
    problem = problem_of(request, path, limits, 1.0, effort)
    bounds = SpeedBounds(problem)
    profile = bounds.profile(problem.start[0], problem.start[1])
    cut = False
    horizon = request.horizon * (1.0 if problem.commanded is None else TIMED_HORIZON_RATIO)
    if profile.times[-1] > horizon:
        reach = np.interp(HORIZON_SHARE * horizon, profile.times, profile.positions)
        count = max(int(path.knots.u.searchsorted(reach)) + 1, len(request.kept.u), 2)
        cut = count < len(path.knots.u)
        path = Path(path.knots[:count])
    if cut:
        problem = problem_of(request, path, limits, 1.0, effort)
        bounds = SpeedBounds(problem)
    if problem.commanded is not None:
        guess = filtered.filtered(problem, bounds)
        if guess is not None:
            late = _lateness(request, path, guess) - _excess(limits) / 2.0
            late[-1] -= _excess(limits) / 2.0
            late = _braked(request, path, limits, late)
            factor, won = _catch_up(request, path, limits, late)
            if found is not None:
                taken, first = _lateness(request, path, found), factor
                late = _braked(request, path, limits, taken) + won
                factor, _ = _catch_up(request, path, limits, late)
                if _ends(request, path):
                    guessed = _guessed_end(request, path, limits, first, effort)
                    later = IN_TIME_S + guessed - float(taken[-1])
                    factor = _in_time_at_the_end(request, path, limits, factor, later, effort)
            problem = problem_of(request, path, limits, factor, effort)
            bounds = SpeedBounds(problem)
    return path, problem, bounds


def _in_time_at_the_end(
    request: Request, path: Path, limits: JointLimits, factor: Array, later: float, effort: Effort
) -> Array:
    """Return a factor on the commanded speeds at each knot that is high enough for the end.

    later: how much later than this the guess may come to it, s.
    """
    low, high = float(factor.min()), request.catch_up
    missed = won = _guessed_end(request, path, limits, factor, effort) - later
    if missed <= 0.0:
        return factor
    for _ in range(BISECTIONS):
        ratio = float(np.sqrt(low * high))
        left = _guessed_end(request, path, limits, np.maximum(factor, ratio), effort) - later
        if left > 0.0:
            low, missed = ratio, left
        else:
            high, won = ratio, left
    if won < 0.0 and np.isfinite(missed):
        high = low * (high / low) ** (missed / (missed - won))
    return np.maximum(factor, high)


def _guessed_end(
    request: Request, path: Path, limits: JointLimits, factor: Array, effort: Effort
) -> float:
    """Return how late the guess is at the end of a path, s."""
    effort.spend(OUTSET_US / 2.0)
    problem = problem_of(request, path, limits, factor, effort)
    guess = filtered.filtered(problem, SpeedBounds(problem))
    return np.inf if guess is None else float(_lateness(request, path, guess)[-1])


def _excess(limits: JointLimits) -> float:
    """Return about how much longer than a plan the guess for it takes, s."""
    return GUESS_EXCESS_SHARE * float(np.max(limits.acceleration / limits.jerk))


def off_the_clock(request: Request, path: Path, timing: TimeParametrisation) -> bool:
    """Return whether a plan passes a knot too long before its time, or ends too late."""
    if not request.timed.any():
        return False
    late = _lateness(request, path, timing)
    return bool(late.min() < -IN_TIME_S or (_ends(request, path) and late[-1] > IN_TIME_S))


def _ends(request: Request, path: Path) -> bool:
    """Return whether a path is that to the end of the trajectory."""
    return request.whole and len(path.knots.u) == len(request.clock)


def _braked(request: Request, path: Path, limits: JointLimits, late: Array) -> Array:
    """Return lateness as it is made up for: to brake for the trajectory's end takes time.

    Half of that is won before, the other half lost at the end; all of it is won where there is
    little before.
    """
    if not _ends(request, path) or len(late) == 1:
        return late
    clock = request.clock[-len(late) :]
    near = clock > clock[-1] - LEAD_IN_STOPPING_TIMES * stopping_time(limits)
    lost = max(late[-1] - late[-2], 0.0)
    late = np.append(late[:-1], late[-2])
    late[near] += lost if near.all() else lost / 2.0
    return late


def _lateness(request: Request, path: Path, timing: TimeParametrisation) -> Array:
    """Return how late a timing is at each knot ahead, s, shape (m,)."""
    knots, clock = path.knots.u, request.clock[: len(path.knots.u)]
    now = float(np.interp(request.state[0], knots, clock))
    first = min(int(knots.searchsorted(request.state[0], side='right')), len(knots) - 1)
    reached = np.interp(knots[first:], np.maximum.accumulate(timing.positions), timing.times)
    late: Array = request.lag + reached - (clock[first:] - now)
    return late


def _catch_up(
    request: Request, path: Path, limits: JointLimits, late: Array
) -> tuple[Array, Array]:
    """Return the factor on the commanded speed at each knot that keeps to the clock.

    And the time that is won with it until each knot ahead, s. late: how late these would be
    reached without.
    """
    knots, clock = path.knots.u, request.clock[: len(path.knots.u)]
    now = float(np.interp(request.state[0], knots, clock))
    first = len(knots) - len(late)
    # with less known than a stop takes, the time that was lost would be lost again in a stop
    spare = (float(request.clock[-1]) - now) / stopping_time(limits)
    share = 1.0 if request.whole else float(np.clip(2.0 * (spare - 1.0), 0.0, 1.0))
    most = 1.0 + share * (min(request.catch_up, LOCAL_RATIO) - 1.0)
    factor, won = np.ones(len(knots)), np.zeros(len(late))
    steps = np.diff(clock[first:], prepend=now)
    gain = 0.0
    for index, (lost, step) in enumerate(zip(late.tolist(), steps.tolist(), strict=True)):
        left = lost - gain
        left -= min(max(left, -IN_TIME_S), IN_TIME_S)
        ratio = 1.0 + CATCH_UP_PER_S * left
        if left < step:  # no more than the time that is left to win, or to lose
            exact = step / (step - left)
            ratio = min(ratio, exact) if left > 0.0 else max(ratio, exact)
        ratio = min(max(ratio, LEAST_RATIO), most)
        gain += step * (1.0 - 1.0 / ratio)
        factor[first + index], won[index] = ratio, gain
    factor[:first] = factor[first]
    return factor, won


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
    squares[::2], squares[1::2] = speeds**2, middle**2
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
    inner = (mean[both] * after + mean[both + 1] * before) / (before + after)
    speeds[both + 1] = np.minimum(inner, KNOT_RATIO * speeds[both + 1])
    speeds[0] = max(2.0 * mean[0] - speeds[1], mean[0]) if timed[0] else UNBOUND_SPEED
    speeds[-1] = max(2.0 * mean[-1] - speeds[-2], mean[-1]) if timed[-1] else UNBOUND_SPEED
    return speeds
