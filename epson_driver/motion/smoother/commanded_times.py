# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The speeds along a path that reach its points at their commanded times, and make up delays.

u is the path parameter. Its time derivative u̇ is called the speed.
"""

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.path import Path
from epson_driver.motion.smoother.request import OUTSET_US, Effort, Problem, Request
from epson_driver.motion.smoother.speed_bounds import SpeedBounds, SpeedProfile

UNBOUND_SPEED = 1e6
"""Value of u̇ where no time is commanded. It is higher than any joint limit allows."""

SMOOTHED_S = 0.03
"""Maximum change of the time at a knot that smoothing the commanded speeds may cause, s."""

MIN_SMOOTHED_SHARE = 0.9
"""Minimum smoothed speed as a fraction of the lowest commanded speed."""

IN_TIME_S = 0.01
"""Maximum delay that is not corrected, s, because a correction would make the motion uneven."""

CATCH_UP_RATIO = 1.25
"""Usual ratio of the speed to the commanded speed while a motion makes up a delay."""

MAX_CATCH_UP_RATIO = 6.0
"""Maximum ratio of the speed to the commanded speed, used if the motion would end late."""

MAX_RAMP_SHARE = 0.9
"""Maximum speed in a ramp at a plan's end, as a fraction of the plan's highest speed."""

LATER_SHARE, LATER_AT_REST_SHARE = 0.3, 0.5
"""Delays of a plan relative to its speed profile, which ignores the jerk limits: after a start
from rest, and before the end at rest. The unit is the ratio of the acceleration limit to the jerk
limit."""

FULL_CATCH_UP_DELAY_S, MAX_DELAY_RATIO = 0.05, 2.4
"""The ratio of the speed to the commanded speed is at most 1 + min(delay / FULL_CATCH_UP_DELAY_S,
MAX_DELAY_RATIO) · (CATCH_UP_RATIO - 1). A long delay results from a rest or a very slow motion."""

HORIZON_SHARE = 0.8
"""Fraction of the planning horizon that the speed profile takes to the end of the planned path.

A plan is slower than the profile, so it takes about the whole horizon.
"""


def within_horizon(
    request: Request, path: Path, limits: JointLimits, effort: Effort
) -> tuple[Problem, SpeedBounds]:
    """Shorten a path to the planning horizon. Return its problem and its speed bounds."""
    effort.spend(OUTSET_US)
    factor: Array | float = min(CATCH_UP_RATIO, request.catch_up)
    problem = problem_of(request, path, limits, factor, effort)
    bounds = SpeedBounds(problem)
    profile = bounds.profile()
    cut = False
    if profile.times[-1] > request.horizon:
        reach = np.interp(HORIZON_SHARE * request.horizon, profile.times, profile.positions)
        count = max(int(path.knots.u.searchsorted(reach)) + 1, len(request.knots.u), 2)
        cut = count < len(path.knots.u)
        path = Path(path.knots[:count])
    if request.timed.any():
        if cut:
            problem = problem_of(request, path, limits, factor, effort)
            profile = SpeedBounds(problem).profile()
        factor = _catch_up(request, path, limits, profile)
        problem = problem_of(request, path, limits, factor, effort)
        bounds = SpeedBounds(problem)
    elif cut:
        problem = problem_of(request, path, limits, 1.0, effort)
        bounds = SpeedBounds(problem)
    return problem, bounds


def commanded_duration(request: Request, path: Path) -> float:
    """Return the time from the state to the commanded time of the end of the path, s."""
    now, end = np.interp([request.state[0], path.end], path.knots.u, request.clock)
    return float(end - now) - request.lag


def highest_speeds(request: Request, path: Path, limits: JointLimits) -> Array:
    """Return the highest u̇ at the places of the commanded speeds, shape (m,).

    The fastest joint is then at most as fast there, relative to its limit, as the plan's fastest
    joint anywhere. This does not apply to a plan without a ramp at an end, because a motion that
    takes its time must be faster.
    """
    commanded = _commanded(request, path, 1.0)
    assert commanded is not None  # noqa: S101 - for the type checker
    places, speeds = commanded[0], np.sqrt(commanded[1])
    fastest = Problem(path, request.state, limits).fastest(path.sample(places)[1])
    shares = np.minimum(speeds, fastest) / fastest
    highest: Array = min(MAX_CATCH_UP_RATIO, request.catch_up) * speeds
    ends = shares[-1:] if request.state[1] else shares[[0, -1]]
    if ends.max() <= MAX_RAMP_SHARE * shares.max():
        highest = np.minimum(shares.max() * fastest, highest)
    return highest


def _catch_up(request: Request, path: Path, limits: JointLimits, profile: SpeedProfile) -> Array:
    """Return the factors of the commanded speed at the knots that remove a delay, shape (k,)."""
    knots = path.knots.u
    clock = request.clock[: len(knots)]
    now = float(np.interp(request.state[0], knots, clock))
    # increase the speed where even the profile is late
    ahead = knots > request.state[0]
    arrival = _arrivals(request, profile, knots[ahead], limits)
    late = np.zeros(len(knots))
    late[ahead] = np.maximum(request.lag + arrival - (clock[ahead] - now) - IN_TIME_S, 0.0)
    late[~ahead] = np.maximum(max(request.lag - IN_TIME_S, 0.0), late[ahead][:1])
    lag = request.lag + IN_TIME_S
    if lag < 0.0:
        # the motion is early: reduce the speed until it is in time
        early = clock - now <= -lag / (CATCH_UP_RATIO - 1.0)
        late[early & (late == 0.0)] = lag
    spare = float(request.clock[-1]) - now
    # if the known motion is shorter than a stop, the stop would lose the time again
    fraction = np.clip((spare / stopping_time(limits) - 1.0) / 0.5, 0.0, 1.0)
    fraction = np.clip(late / FULL_CATCH_UP_DELAY_S, -1.0, MAX_DELAY_RATIO * fraction)
    factor = 1.0 + fraction * (CATCH_UP_RATIO - 1.0)
    # limit the factor to the one that makes up the delay between the two adjacent midpoints
    intervals = np.diff(clock)
    nearby = (np.append(intervals[:1], intervals) + np.append(intervals, intervals[-1:])) / 2.0
    shortened = nearby - late
    exact = np.full_like(shortened, np.inf)
    np.divide(nearby, shortened, out=exact, where=shortened > 0.0)
    factor = np.where(late > 0.0, np.minimum(factor, exact), np.maximum(factor, exact))
    bounded: Array = np.minimum(factor, request.catch_up)
    return bounded


def _arrivals(
    request: Request, profile: SpeedProfile, places: Array, limits: JointLimits
) -> Array:
    """Return the estimated times, s, at which a plan passes u = `places`, and ends at the last."""
    ramp = float(np.max(limits.acceleration / limits.jerk))
    times: Array = np.interp(places, profile.positions, profile.times)
    if request.state[1] == 0.0:
        times += LATER_SHARE * np.minimum(times, ramp)
    times[-1] += LATER_AT_REST_SHARE * ramp
    return times


def stopping_time(limits: JointLimits) -> float:
    """Return the approximate duration of a stop from full speed, s."""
    slowing = np.max(limits.velocity / limits.acceleration)
    return float(slowing + np.max(limits.acceleration / limits.jerk))


def problem_of(
    request: Request, path: Path, limits: JointLimits, factor: Array | float, effort: Effort
) -> Problem:
    """Return the planning problem with the commanded speed multiplied by `factor`.

    factor: one number, or one per knot, shape (k,).
    """
    return Problem(path, request.state, limits, _commanded(request, path, factor), effort)


def _commanded(request: Request, path: Path, factor: Array | float) -> tuple[Array, Array] | None:
    """Return path parameters u and the commanded u̇² at them, or None if no time is commanded."""
    u = path.knots.u
    clock = request.clock[: len(u)]
    timed = request.timed[1 : len(u)] & (np.diff(clock) > 0.0)
    if not timed.any():
        return None
    bounds = np.flatnonzero(np.diff(timed, prepend=False, append=False))
    runs = [(u[:1], np.array([UNBOUND_SPEED]))] if not timed[0] else []
    for start, end in bounds.reshape(-1, 2).tolist():
        run = slice(start, end + 1)
        runs.append(_smooth_speeds(u[run], clock[run]))
        if end < len(timed):
            runs.append((u[end : end + 2].mean(keepdims=True), np.array([UNBOUND_SPEED])))
    if not timed[-1]:
        runs.append((u[-1:], np.array([UNBOUND_SPEED])))
    places, speeds = (np.concatenate(parts) for parts in zip(*runs, strict=True))
    return places, (np.interp(places, u, np.broadcast_to(factor, len(u))) * speeds) ** 2


def _smooth_speeds(u: Array, clock: Array) -> tuple[Array, Array]:
    """Return path parameters, and the speed at each of them.

    A motion with these speeds reaches the knots `u` approximately at the times `clock`, s.

    Between two knots the speed is the mean speed. Around each knot it changes with a constant
    acceleration. The change takes as long as the shorter adjacent interval. It is shorter if the
    knot would otherwise be more than SMOOTHED_S early or late, but it takes at least SMOOTHED_S on
    each side of the knot.
    """
    intervals = np.diff(clock)
    mean = np.diff(u) / intervals
    root = np.sqrt(mean[1:] / mean[:-1])
    with np.errstate(divide='ignore'):
        longest = SMOOTHED_S * (root + 1.0) / np.abs(root - 1.0)
    shorter = np.minimum(intervals[:-1], intervals[1:])
    half = np.maximum(np.minimum(shorter / 2.0, longest), SMOOTHED_S)
    inner = clock[1:-1]
    half = np.minimum(half, np.minimum(inner - clock[0], clock[-1] - inner))
    times = np.concatenate([clock[:1], inner - half, inner + half, clock[-1:]])
    slope = np.diff(mean) / (2.0 * half)
    slopes = np.concatenate([[0.0], slope, -slope, [0.0]])
    order = np.argsort(times, kind='stable')
    steps = np.diff(times[order])
    speeds = mean[0] + np.append(0.0, np.cumsum(np.cumsum(slopes[order])[:-1] * steps))
    # rounding can make a speed lower than this
    speeds = np.maximum(speeds, MIN_SMOOTHED_SHARE * mean.min())
    places = u[0] + np.append(0.0, np.cumsum((speeds[:-1] + speeds[1:]) / 2.0 * steps))
    return np.minimum(places, u[-1]), speeds
