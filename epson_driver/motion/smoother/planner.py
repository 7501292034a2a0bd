# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The planner, a function from a request to a plan without any state.

A plan is a path with the path parameter u, and a timing u(t) that ends at rest and is verified
against every limit. The simulated controller runs the planner in a separate process.
"""

import dataclasses

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother import optimal, ruckig_move
from epson_driver.motion.smoother.commanded_times import (
    commanded_duration,
    highest_speeds,
    problem_of,
    stopping_time,
    within_horizon,
)
from epson_driver.motion.smoother.path import Knots, Path, chord_lengths, in_time, line, through
from epson_driver.motion.smoother.request import MAX_EFFORT_US, Effort, Plan, Problem, Request
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.time_parametrisation import TimeParametrisation, as_commanded

REACHES_IN_BRAKING_DISTANCES = (1.5, 2.0, 3.0, 4.0, 6.0)
"""Distances to a stop that are tried, as multiples of the shortest braking distance."""

MIN_SEGMENT_SHARE = 0.1
"""Minimum distance of a rest after a knot, as a fraction of the segment. A rest that would be
closer is moved to the knot."""


def _pause(problem: Problem) -> TimeParametrisation | None:
    """Return a verified timing that comes to rest soon, or None if none was found.

    A motion that uses its limits fully cannot always brake immediately, because the joints may
    need their limits to follow a bend of the path. In this case it comes to rest slightly later.
    """
    timing = ruckig_move.stop(problem)
    if timing is not None:
        return timing
    slope, limits = np.abs(problem.path.at(problem.start[0])[1]), problem.limits
    with np.errstate(divide='ignore'):
        acceleration, jerk = limits.acceleration / slope, limits.jerk / slope
    hardest = ruckig_move.brake(problem.start, float(np.min(acceleration)), float(np.min(jerk)))
    if hardest is None:
        return None
    first = problem.start[0]
    for reach in REACHES_IN_BRAKING_DISTANCES:
        end = first + reach * (hardest.end - first)
        if not first < end < problem.end:
            return None
        timing = _rest_at(problem, _until(problem.path, first, end))
        if timing is not None:
            return timing
    return None


def _rest_at(problem: Problem, path: Path) -> TimeParametrisation | None:
    shorter = dataclasses.replace(problem, path=path, commanded=None)
    timing = optimal.propose(shorter, SpeedBounds(shorter))
    if timing is None or not problem.usage(timing).allowed:
        return None
    return timing


def _until(path: Path, start: float, end: float) -> Path:
    """Return a part of a path, from the segment that contains u = `start` to u = `end`.

    If a knot is just before `end`, the part ends at this knot.
    """
    knots = path.knots
    first, last = path.segment(start), path.segment(end)
    part = (end - knots.u[last]) / (knots.u[last + 1] - knots.u[last])
    if part < MIN_SEGMENT_SHARE and last > first:
        return Path(knots[first : last + 1])
    position, slope, bend = path.at(end)
    head = knots[first : last + 1]
    return Path(
        Knots(
            np.append(head.u, end),
            np.vstack([head.position, position]),
            np.vstack([head.first, slope]),
            np.vstack([head.second, bend]),
        )
    )


URGENT_SHARE = 0.15
"""Additional computing effort that an urgent plan may take, as a fraction of MAX_EFFORT_US."""

OPTIMAL, BRANCH, AS_COMMANDED = 'optimal', 'branch', 'as commanded'

BRAKING_IN_STOPPING_TIMES = (1.5, 2.2, 3.0)
"""Times before the last known point at which a plan that keeps the commanded times may begin to
brake for it."""

MAX_END_ROUNDS, END_SHARE = 3, 5e-3
"""Maximum number of other speeds with which a motion is planned to end at its commanded time, and
the accepted difference, as a fraction of the time left."""

FIRST_END_EXPONENT, MIN_END_SLOPE = 1.5, -0.1
"""The first change of the speed is the ratio of the durations, raised to this exponent. Above this
derivative of ln(duration) with respect to ln(speed), the limits determine the duration."""

UNSETTLED_KNOTS = 6
"""Number of knots before the last known one whose derivatives still depend on the next points."""

MAX_BEND_RATIO, FREE_BEND = 1.5, 1e-2
"""A spline of time may be farther from the lines between its points than the usual spline by this
ratio, or by FREE_BEND, rad (or m), in all."""

MIN_COMMANDED_S = 0.05
"""Minimum time from the start of such a plan until it brakes, s."""

BRANCH_SHARES = (0.15, 0.4, 0.75)
"""Times at which a plan may branch off from the current one, as fractions of the current plan's
duration."""

BRANCH_HORIZON_SHARE = 0.6
"""Planning horizon of a plan that branches off, as a fraction of the usual horizon."""

BRANCH_TOLERANCE = 1e-2
"""Accepted excess of the duration of a plan that branches off, relative to the optimum."""


def plan(request: Request, limits: JointLimits) -> Plan | None:
    """Return a verified plan, or None if none was found and the current plan must continue."""
    effort = Effort()
    result = None if request.pause else _as_commanded(request, limits, effort)
    if result is None:
        result = _within_limits(request, limits, effort)
        if result is not None and request.in_time:
            result = dataclasses.replace(result, in_time=True)
    return result


def _within_limits(request: Request, limits: JointLimits, effort: Effort) -> Plan | None:
    """Return a plan that respects the commanded times where the limits allow it, or None."""
    first = _path(request, request.knots, limits)
    if request.pause:
        path = first if request.current_knots is None else Path(request.current_knots)
        timing = _pause(problem_of(request, path, limits, 1.0, effort))
        return None if timing is None else Plan(request.start, path.knots, timing, 'stop')
    at_rest = len(request.knots.u) == 1
    if at_rest and len(request.points) == 1 and request.whole and not request.timed.any():
        # the straight path is optimal, because the arm is at rest before and after it
        result = _straight(request, limits)
        if result is not None:
            return result
    result = _fresh(request, first, limits, effort)
    for fraction in () if at_rest else BRANCH_SHARES:
        if result is None:
            result = _branch(request, fraction, limits, effort)
    if result is None and not effort.used_up:
        result = _fresh(request, first, limits, effort, optimal.SHORT_RAMP_TIME_S)
    if result is None and at_rest:
        return _straight(request, limits)
    if result is None and request.urgent:
        return _simple(request, first, limits)
    return result


def _as_commanded(request: Request, limits: JointLimits, effort: Effort) -> Plan | None:
    """Return a plan that respects all commanded times exactly, or None.

    The path is the cubic spline of time through the points. Such a plan exists if the points are
    close enough in time, and their times need no more than the limits. It keeps them until it must
    brake for the last known point.
    """
    at_rest = len(request.knots.u) == 1
    on_time = request.in_time and request.state[1:] == (1.0, 0.0)
    if not (request.timed[1:].all() and len(request.points) and (at_rest or on_time)):
        return None
    clock = request.clock[len(request.knots.u) - 1 :]
    path = in_time(request.knots, request.points, clock, request.ends)
    if not _is_near(path, request, limits):
        return None
    start, knots = request.state[0], path.knots.u
    if request.ends and _is_slow(path, knots, limits):
        timing = as_commanded(start, path.end, rests=True)
        if Problem(path, request.state, limits, effort=effort).usage(timing).allowed:
            return Plan(request.start, path.knots, timing, AS_COMMANDED, True)
    if request.ends and not request.whole:
        path = in_time(request.knots, request.points, clock, final=False)
    settled = knots[: max(len(knots) - UNSETTLED_KNOTS, 1)]
    if not _is_slow(path, settled, limits):
        return None
    for times in BRAKING_IN_STOPPING_TIMES:
        end = path.end - times * stopping_time(limits)
        end = min(max(end, start + MIN_COMMANDED_S), float(settled[-1]))
        if effort.used_up or end < start + MIN_COMMANDED_S:
            break
        tail = Problem(path, (end, 1.0, 0.0), limits, (knots, np.ones_like(knots)), effort)
        braking = optimal.propose(tail, SpeedBounds(tail), tolerance=BRANCH_TOLERANCE)
        if braking is None:
            continue
        timing = as_commanded(start, end, rests=False).then(braking)
        if tail.usage(timing).allowed:
            return Plan(request.start, path.knots, timing, AS_COMMANDED, True)
    return None


def _is_slow(path: Path, places: Array, limits: JointLimits) -> bool:
    """Return whether accelerations and jerks at u = `places` respect the limits if u̇ = 1."""
    _, _, acceleration, jerk = path.sample(places)
    return bool(
        np.all(np.abs(acceleration) <= limits.acceleration) and np.all(np.abs(jerk) <= limits.jerk)
    )


def _is_near(path: Path, request: Request, limits: JointLimits) -> bool:
    """Return whether a path in time is about as near to the lines between its points as usual.

    It is not if the times are irregular.
    """
    chain = np.concatenate([request.knots.position, request.points])
    still = np.zeros_like(chain[:1])
    usual = through(Knots(np.zeros(1), chain[:1], still, still), chain[1:], limits, False, True)
    bends = np.stack([path.bends(), usual.bends()])[:, -len(request.points) :]
    return bool(np.all(bends[0] <= np.maximum(MAX_BEND_RATIO * bends[1], FREE_BEND)))


def _fresh(
    request: Request,
    first: Path,
    limits: JointLimits,
    effort: Effort,
    ramp_time: float = optimal.MAX_RAMP_TIME_S,
) -> Plan | None:
    """Return a plan that does not depend on the current plan's timing, or None."""
    problem, bounds = within_horizon(request, first, limits, effort)
    timing = optimal.propose(problem, bounds, ramp_time)
    path, commanded = problem.path, problem.commanded
    ends = request.ends and len(path.knots.u) == len(first.knots.u)
    if timing is not None and ends and commanded is not None:
        timing = _ending_in_time(request, problem, commanded, timing, ramp_time)
    return None if timing is None else Plan(request.start, path.knots, timing, OPTIMAL)


def _ending_in_time(
    request: Request,
    problem: Problem,
    commanded: tuple[Array, Array],
    timing: TimeParametrisation,
    ramp_time: float,
) -> TimeParametrisation:
    """Return a timing that ends nearer to the commanded time than `timing`, or `timing`.

    All commanded speeds are multiplied by a ratio for this, up to `highest_speeds`.
    """
    left = commanded_duration(request, problem.path)
    places, squares = commanded
    highest = highest_speeds(request, problem.path, problem.limits)
    tried = [(0.0, timing.duration, timing)]  # logarithm of the ratio, duration, timing
    for _ in range(MAX_END_ROUNDS):
        exponent, duration, _ = tried[-1]
        if abs(duration - left) <= END_SHARE * left or left <= 0.0 or problem.effort.used_up:
            break
        slope = -1.0 / FIRST_END_EXPONENT
        if len(tried) > 1:
            before, previous, _ = tried[-2]
            if (slope := np.log(duration / previous) / (exponent - before)) > MIN_END_SLOPE:
                break  # the limits determine the duration
        exponent += float(np.log(left / duration)) / slope
        speeds = np.minimum(np.exp(exponent) * np.sqrt(squares), highest)
        changed = dataclasses.replace(problem, commanded=(places, speeds**2))
        found = optimal.propose(changed, SpeedBounds(changed), ramp_time)
        if found is None:
            break
        tried.append((exponent, found.duration, found))
    return min(tried, key=lambda item: abs(item[1] - left))[2]


def _branch(request: Request, fraction: float, limits: JointLimits, effort: Effort) -> Plan | None:
    """Return a plan that follows the current plan for a fraction of its duration, or None.

    After this fraction, the plan takes the fastest timing through the request's points. Such a
    plan is needed because a motion that uses its limits fully may allow no change before it
    brakes.
    """
    current_timing, current_knots = request.current_timing, request.current_knots
    if current_timing is None or current_knots is None or effort.used_up:
        return None
    first = fraction * current_timing.duration
    state = current_timing.at(first)
    head = current_timing.part(0.0, first)
    if head is None or state[0] >= current_knots.u[-1]:
        return None
    path = _path(request, current_knots, limits)
    clock = np.interp([request.state[0], state[0]], path.knots.u, request.clock)
    later = dataclasses.replace(
        request,
        state=state,
        current_timing=current_timing.part(first),
        lag=request.lag + first - float(clock[1] - clock[0]),
        horizon=BRANCH_HORIZON_SHARE * request.horizon,
    )
    problem, bounds = within_horizon(later, path, limits, effort)
    timing = optimal.propose(problem, bounds, tolerance=BRANCH_TOLERANCE)
    if timing is not None:
        timing = head.then(timing)
    if timing is not None and not problem.usage(timing).allowed:
        timing = None
    return None if timing is None else Plan(request.start, problem.path.knots, timing, BRANCH)


def _simple(request: Request, first: Path, limits: JointLimits) -> Plan | None:
    """Return a plan of a single move along the path, which may be slow, or None."""
    effort = Effort(URGENT_SHARE * MAX_EFFORT_US)
    problem, _ = within_horizon(request, first, limits, effort)
    timing = ruckig_move.propose(problem)
    return None if timing is None else Plan(request.start, problem.path.knots, timing, 'simple')


def _straight(request: Request, limits: JointLimits) -> Plan | None:
    path = line(request.knots, request.points[0], limits)
    timing = ruckig_move.only_move(problem_of(request, path, limits, 1.0, Effort()))
    return None if timing is None else Plan(request.start, path.knots, timing, 'straight')


def _path(request: Request, knots: Knots, limits: JointLimits) -> Path:
    points = request.points[len(knots.u) - len(request.knots.u) :]
    if not len(points):
        return Path(knots)
    if request.in_time:
        path = in_time(knots, points, request.clock[len(knots.u) - 1 :], request.whole)
        outside = path.outside(limits)[len(knots.u) - 1 :]
        if not outside.any() and _is_near(path, request, limits):
            return path
        # continue by the length, in the scale of the last segment
        scale = np.diff(knots.u[-2:]) / chord_lengths(knots.position[-2:], limits)
        limits = dataclasses.replace(limits, velocity=limits.velocity / float(scale[0]))
    return through(knots, points, limits, clamped=len(knots.u) > 1, final=request.whole)
