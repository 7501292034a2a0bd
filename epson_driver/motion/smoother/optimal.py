# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The (locally) fastest time parametrisation of a path.

u is the path parameter, x(u) = u̇² the square of the speed, and q′, q″, q‴ are the derivatives of
a joint's position with respect to u. With the joint's limits V, A and J, the constraints are
    velocity      |q′| √x ≤ V
    acceleration  |q′x′/2 + q″x| ≤ A
    jerk          |q′x″/2 + 3q″x′/2 + q‴x| ≤ J / √x
and the time is ∫ du / √x (Verscheure et al. 2009; jerk: Debrouwere et al. 2013). All of this is
convex except the right side of the jerk limit. x is a spline, and `interior_point` finds its
coefficients.
"""

import dataclasses
import math

import numpy as np
import numpy.ma  # otherwise the first call of setdiff1d imports it, which takes 0.1 s

from epson_driver.motion.limits import Array
from epson_driver.motion.smoother.interior_point import RELATIVE_TOLERANCE, Program, minimise
from epson_driver.motion.smoother.limit_usage import LimitUsage
from epson_driver.motion.smoother.request import ROUND_US, Problem
from epson_driver.motion.smoother.speed_bounds import SpeedBounds, SpeedProfile
from epson_driver.motion.smoother.speed_spline import Ramp, SpeedSpline, basis
from epson_driver.motion.time_parametrisation import TimeParametrisation

NODE_SPACING_S = 0.008
"""Time between two nodes of the spline x(u) in the initial timing, s."""

MAX_RAMP_TIME_S = 0.024
"""Maximum duration of a ramp, s: a start from rest or an end at rest with constant jerk."""

SHORT_RAMP_TIME_S = 0.008
"""Maximum duration of a ramp in the second attempt, s."""

RAMP_VIEW = 3.0
"""Time from a rest for which a ramp's jerk is checked, as a multiple of the maximum duration of a
ramp."""

MIN_NODES, MAX_NODES = 8, 180

VELOCITY_RESERVE_SHARE, ACCELERATION_RESERVE_SHARE, JERK_RESERVE_SHARE = 5e-4, 1e-2, 4e-2
"""Fractions of the limits that remain unused, because the spline respects them only at samples."""

MAX_KNOTS = 4
"""Maximum number of path knots between two nodes at which the limits are constraints."""

START_INTERVALS = 10
"""Number of intervals after a start in motion that use the velocity and acceleration limits fully,
and half of the jerk reserve."""

FINER_RATIO = 1.03
"""Ratio of a value to its limit above which the first round adds nodes at this place."""

COARSE_RATIO = 1.3
"""The first round only adds nodes if a ratio of a value to its limit is above this, because sparse
nodes hide the allowed speed."""

FINAL_INTERVALS = 4
"""Number of intervals at the end that get no additional nodes, so that the ramp to rest is
unchanged."""

MAX_ROUNDS = 4
"""Maximum number of rounds. Each reduces the speed where the previous timing exceeds a limit."""

EXCESS_MARGIN_RATIO = 1.01
"""Divisor of the limits in the round after an excess. In the intervals with the excess, the
divisor is the square of this constant times the ratio of the value to its limit."""

EXCESS_NEIGHBOURS = 2
"""Number of intervals on either side of an excess in which the limits are reduced, too."""

MAX_LESS_RATIO = 4.0
"""Maximum factor by which one round divides the limits in an interval."""

MAX_GENTLER_RAMPS = 20

GENTLER_RAMP_RATIO = 0.7
"""Factor of each reduction of a ramp's jerk."""

Excess = tuple[Array, Array]
"""Path parameters u at which a limit is exceeded, and the ratios of the values to the limit."""

_SAMPLES = np.array([0.02, 0.98])
_WEIGHTS = np.array([0.5, 0.5])
_BESIDE = 1e-9
_ALONG_RAMP = np.array([0.0, 0.25, 0.5, 0.75, 1.0])


def propose(
    problem: Problem,
    bounds: SpeedBounds,
    ramp_time: float = MAX_RAMP_TIME_S,
    tolerance: float = RELATIVE_TOLERANCE,
) -> TimeParametrisation | None:
    """Return a verified, nearly optimal timing, or None if none was found.

    ramp_time: maximum duration of a ramp, s. tolerance: accepted excess of the duration over the
    optimum, relative to it.
    """
    ramps = _ramps(problem, bounds, ramp_time)
    if ramps is None:
        return None
    spline = _spline(problem, bounds.profile(), *ramps)
    excess: list[Excess] = []
    for turn in range(MAX_ROUNDS):
        if spline is None:
            return None
        problem.effort.spend(ROUND_US)
        coefficients = minimise(
            _program(problem, spline, excess), spline.coefficients, problem.effort, tolerance
        )
        if coefficients is None:
            return None
        spline = dataclasses.replace(spline, coefficients=coefficients)
        timing = spline.timing(problem.start, problem.end)
        if timing is None:
            return None
        result = problem.usage(timing)
        if result.allowed:
            return timing
        places, ratios = _excess(result)
        if not result.inside and not len(places):
            return None  # a lower speed does not help
        finer = places[(ratios > FINER_RATIO) & (places < spline.nodes[-1 - FINAL_INTERVALS])]
        if turn > 0 or not len(finer) or ratios.max() <= COARSE_RATIO:
            excess.append((places, ratios))
        if turn == 0 and len(finer):
            spline = _finer(problem, spline, timing, finer)
    return None


def _ramps(problem: Problem, bounds: SpeedBounds, ramp_time: float) -> tuple[Ramp, Ramp] | None:
    """Return the ramps at both ends, or None if the path is too short for them."""
    distance = problem.end - problem.start[0]
    ramps = []
    for end, inward in ((problem.start[0], 1.0), (problem.end, -1.0)):
        jerk = np.inf
        for _ in range(2):  # with the values at the end itself, then with those along the ramp
            back = inward * min(jerk * (RAMP_VIEW * ramp_time) ** 3 / 6.0, distance / 2.0)
            places = end + (0.0 if jerk == np.inf else back * _ALONG_RAMP)
            _, first, _, _ = problem.path.sample(np.atleast_1d(places))
            with np.errstate(divide='ignore'):
                slopes = problem.limits.jerk / np.abs(first)
            jerk = (1.0 - JERK_RESERVE_SHARE) * float(np.min(slopes))
        # the speed at the end of the ramp must be below the bounds nearby
        near = np.abs(bounds.positions - end) < 2.0 * jerk * ramp_time**3
        speed = float(bounds.speeds[near].min(initial=np.inf))
        longest = min((0.4 * speed / jerk) ** 0.5, (0.6 * distance / jerk) ** (1.0 / 3.0))
        time = float(np.clip(longest, NODE_SPACING_S, ramp_time))
        ramp = Ramp(min(jerk, 0.6 * speed / time**2), time)
        ramps.append(_allowed_ramp(problem, ramp, end, inward))
    if problem.start[1] > 0.0:
        ramps[0] = Ramp(0.0, 0.0)
    if problem.start[0] + ramps[0].length + ramps[1].length >= problem.end:
        return None
    return ramps[0], ramps[1]


def _allowed_ramp(problem: Problem, ramp: Ramp, end: float, inward: float) -> Ramp:
    """Return a ramp with its jerk reduced until it exceeds no acceleration or jerk limit.

    end: u at rest. inward: 1 for a start from rest, -1 for an end at rest.
    """
    limits = problem.limits
    times = ramp.time * _ALONG_RAMP
    jerk = ramp.jerk
    for _ in range(MAX_GENTLER_RAMPS):
        v, a = jerk * times[:, None] ** 2 / 2.0, inward * jerk * times[:, None]
        _, first, second, third = problem.path.sample(end + inward * jerk * times**3 / 6.0)
        accelerations = np.abs(first * a + second * v**2) / limits.acceleration
        jerks = np.abs(first * jerk + 3.0 * second * v * a + third * v**3) / limits.jerk
        if (
            accelerations.max() <= 1.0 - ACCELERATION_RESERVE_SHARE
            and jerks.max() <= 1.0 - JERK_RESERVE_SHARE / 2.0
        ):
            break
        jerk *= GENTLER_RAMP_RATIO
    return Ramp(jerk, ramp.time)


def _spline(
    problem: Problem, profile: SpeedProfile, start_ramp: Ramp, end_ramp: Ramp
) -> SpeedSpline | None:
    """Return a spline slightly slower than a profile.

    The result is None if nodes would coincide, or if the second coefficient is not positive.
    """
    us = profile.positions
    start, end = problem.start[0] + start_ramp.length, problem.end - end_ramp.length
    us = np.maximum.accumulate(us) + np.linspace(0.0, 1e-9, len(us))
    times = _slow_ends(us, profile.times, start_ramp, end_ramp)
    first, last = np.interp([start, end], us, times)
    count = int(np.clip((last - first) / NODE_SPACING_S, MIN_NODES, MAX_NODES))
    nodes = np.interp(np.linspace(first, last, count + 1), times, us)
    nodes = 0.98 * nodes + 0.02 * np.linspace(start, end, count + 1)
    nodes[0], nodes[-1] = start, end
    nodes = _on_knots(nodes, problem.path.knots.u)
    speeds = np.interp(_middles(nodes), us, profile.speeds)
    return _of_speeds(problem, nodes, math.sqrt(0.8) * speeds, start_ramp, end_ramp)


def _finer(
    problem: Problem, spline: SpeedSpline, timing: TimeParametrisation, places: Array
) -> SpeedSpline | None:
    """Return a timing's spline with more nodes around `places`. None: see `_spline`.

    places: path parameters u.
    """
    nodes = spline.nodes
    near = np.zeros(len(nodes) - 1, dtype=bool)
    interval = np.clip(nodes.searchsorted(places, side='right') - 1, 0, len(near) - 1)
    for neighbour in (-1, 0, 1):
        near[np.clip(interval + neighbour, 0, len(near) - 1)] = True
    nodes = np.sort(np.concatenate([nodes, ((nodes[1:] + nodes[:-1]) / 2.0)[near]]))
    speeds = np.interp(_middles(nodes), timing.positions, timing.velocities)
    return _of_speeds(problem, nodes, speeds, spline.start_ramp, spline.end_ramp)


def _of_speeds(
    problem: Problem, nodes: Array, speeds: Array, start_ramp: Ramp, end_ramp: Ramp
) -> SpeedSpline | None:
    """Return a spline with speeds u̇ at `_middles` of given nodes. None: see `_spline`."""
    h = np.diff(nodes)
    if np.min(h) <= _BESIDE:
        return None
    x = np.maximum(speeds**2, 1e-8)
    v, a = problem.start[1], problem.start[2]
    if start_ramp.time > 0.0:
        v, a = start_ramp.speed, start_ramp.acceleration
    x[0], x[1] = v**2, v**2 + a * h[0]
    v, a = end_ramp.speed, end_ramp.acceleration
    x[-1], x[-2] = v**2, v**2 + a * h[-1]
    return SpeedSpline(start_ramp, end_ramp, nodes, x) if x[1] > 0.0 else None


def _slow_ends(us: Array, times: Array, start_ramp: Ramp, end_ramp: Ramp) -> Array:
    """Return the times of samples. A step that is too short for a ramp's jerk is lengthened."""
    steps = np.diff(times)
    if start_ramp.time > 0.0:
        steps = np.maximum(steps, np.diff(np.cbrt(6.0 * (us - us[0]) / start_ramp.jerk)))
    steps = np.maximum(steps, -np.diff(np.cbrt(6.0 * (us[-1] - us) / end_ramp.jerk)))
    return np.append(0.0, np.cumsum(steps))


def _middles(nodes: Array) -> Array:
    """Return the path parameter at which each coefficient has its maximum weight, (N + 2,)."""
    return np.concatenate((nodes[:1], (nodes[:-1] + nodes[1:]) / 2.0, nodes[-1:]))


def _on_knots(nodes: Array, knots: Array) -> Array:
    """Return the nodes after moving the nearest one to each path knot, where the jerk may jump."""
    knots = knots[(knots > nodes[0]) & (knots < nodes[-1])]
    if not len(knots):
        return nodes
    left = np.clip(nodes.searchsorted(knots) - 1, 0, len(nodes) - 2)
    nearest = np.where(knots - nodes[left] < nodes[left + 1] - knots, left, left + 1)
    inner = (nearest > 0) & (nearest < len(nodes) - 1)
    moved = nodes.copy()
    moved[nearest[inner]] = knots[inner]
    return moved


def _program(problem: Problem, spline: SpeedSpline, excess: list[Excess]) -> Program:
    """Return the optimisation program that minimises the time of a spline within the limits.

    The limits apply at both ends of each interval, and at both sides of path knots. The
    acceleration is the same on both sides of a node. It is therefore compared with its lower bound
    on one side only, and with its upper bound on the other side only.
    """
    nodes, h, limits = spline.nodes, spline.lengths, problem.limits
    us = (nodes[:-1, None] + h[:, None] * _SAMPLES).ravel()
    weights = (h[:, None] * _WEIGHTS).ravel()
    # the jerk jumps at the knots of the path, so sample both sides of knots that are not nodes
    knots = problem.path.knots.u
    knots = _few(np.setdiff1d(knots[(knots > nodes[0]) & (knots < nodes[-1])], nodes), nodes)
    us = np.concatenate((us, knots - _BESIDE, knots + _BESIDE))
    weights = np.append(weights, np.zeros(2 * len(knots)))
    interval = np.clip(nodes.searchsorted(us, side='right') - 1, 0, len(h) - 1)
    _, first, second, third = problem.path.sample(us)
    # the state at the start may use the limits fully
    starting = (us < nodes[min(START_INTERVALS, len(h))]) & (spline.start_ramp.time == 0.0)
    reserve = np.where(starting, 0.0, 1.0)
    a = np.stack([second, first / 2.0, np.zeros_like(first)], axis=2)
    a /= ((1.0 - reserve * ACCELERATION_RESERVE_SHARE)[:, None] * limits.acceleration)[:, :, None]
    j = np.stack([third, 1.5 * second, first / 2.0], axis=2)
    j /= ((1.0 - (0.5 + 0.5 * reserve) * JERK_RESERVE_SHARE)[:, None] * limits.jerk)[:, :, None]
    # one of an interval's two samples represents its middle
    back = np.zeros_like(us)
    back[1 : 2 * len(h) : 2] = (_SAMPLES[1] - 0.5) * h
    counted = problem.path.sample(us - back)[1]
    fastest = problem.fastest(counted)
    v = np.stack([np.ones_like(us), -back, back**2 / 2.0], axis=1)[:, None, :]
    v *= (((1.0 - reserve * VELOCITY_RESERVE_SHARE) * fastest) ** -2)[:, None, None]
    a[np.append(np.tile([1.0, -1.0], len(h)), np.repeat([-1.0, 1.0], len(knots))) < 0.0] *= -1.0
    rows = np.concatenate([v, a, j, -j], axis=1)
    rows /= _fraction(excess, nodes)[interval][:, None, None]
    return Program(
        basis(h, interval, (us - nodes[interval]) / h[interval]),
        interval,
        rows,
        1 + len(limits.names),
        back,
        weights,
        problem.target_speeds(us - back, counted),
    )


def _few(knots: Array, nodes: Array) -> Array:
    after = nodes.searchsorted(knots)
    counts = np.bincount(after, minlength=len(nodes))
    rank = np.arange(len(knots)) - (np.cumsum(counts) - counts)[after]
    few: Array = knots[rank % -(-counts // MAX_KNOTS)[after] == 0]
    return few


def _excess(result: LimitUsage) -> Excess:
    ratio = np.maximum(result.velocity, np.maximum(result.acceleration, result.jerk))
    where = ratio > 1.0
    return result.positions[where], ratio[where]


def _fraction(excess: list[Excess], nodes: Array) -> Array:
    """Return each interval's fraction of the limits, reduced after each measured excess."""
    fraction = np.ones(len(nodes) - 1)
    for us, ratio in excess:
        where = np.clip(nodes.searchsorted(us, side='right') - 1, 0, len(fraction) - 1)
        worst = np.ones_like(fraction)
        np.maximum.at(worst, where, ratio)
        for _ in range(EXCESS_NEIGHBOURS):
            worst[1:-1] = np.maximum(worst[1:-1], np.maximum(worst[:-2], worst[2:]))
        # reduce the limits slightly everywhere, as a reduction at one place speeds up others
        less = np.where(worst > 1.0, EXCESS_MARGIN_RATIO, 1.0) * EXCESS_MARGIN_RATIO
        fraction /= np.minimum(less * worst, MAX_LESS_RATIO)
    return fraction
