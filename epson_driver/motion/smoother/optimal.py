# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The (locally) fastest time parametrisation of a path.

For x(u) = u̇² the limits of a joint with derivatives q′, q″, q‴ by u are
    velocity      |q′| √x ≤ V
    acceleration  |q′x′/2 + q″x| ≤ A
    jerk          |q′x″/2 + 3q″x′/2 + q‴x| ≤ J / √x
and the time is ∫ du / √x (Verscheure et al. 2009; jerk: Debrouwere et al. 2013). All of this is
convex except the right side of the jerk limit. With a spline for x, `interior_point` finds the
minimum.
"""

import dataclasses
import math

import numpy as np

from epson_driver.motion.limits import Array
from epson_driver.motion.smoother.interior_point import RELATIVE_TOLERANCE, Program, minimise
from epson_driver.motion.smoother.limit_usage import LimitUsage
from epson_driver.motion.smoother.request import ROUND_US, Problem
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.smoother.speed_spline import Ramp, SpeedSpline, basis
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation

NODE_SPACING_S = 0.008
"""Time between the spline's nodes on the initial timing, s."""

MAX_RAMP_TIME_S = 0.024
"""Longest ramp of constant jerk from or to rest, s."""

SHORT_RAMP_TIME_S = 0.008
"""Longest such ramp in the next attempt if no timing was found, s."""

RAMP_VIEW = 3.0
"""Length of path at an end that is checked for a ramp, in multiples of the ramp's time."""

MIN_NODES, MAX_NODES = 8, 180

VELOCITY_RESERVE_SHARE, ACCELERATION_RESERVE_SHARE, JERK_RESERVE_SHARE = 5e-4, 1e-2, 4e-2
"""Shares of the limits held in reserve. The spline respects the limits only at its samples, the
timing must respect them everywhere."""

MAX_KNOTS = 4
"""Maximum path knots per node interval that get constraint rows."""

START_INTERVALS = 10
"""Number of intervals at the start without this reserve (for jerk, with half of it)."""

FINER_RATIO = 1.03
"""Ratio of usage to limit, after the first round, above which nodes are added at an excess because
they are too far apart there."""

COARSE_RATIO = 1.3
"""Ratio of usage to limit above which an excess of the first round does not show the allowed
speed, so that nodes are added but the speed is not reduced by it."""

FINAL_INTERVALS = 4
"""Intervals at the end without added nodes: the ramp to rest and its neighbours stay unchanged."""

MAX_ROUNDS = 4
"""Maximum rounds. Each starts with the previous timing and reduces the speed at an excess."""

EXCESS_MARGIN_RATIO = 1.01
"""After an excess all limits are divided by this factor, and in the intervals with the excess by
its square times the ratio of the excess."""

EXCESS_NEIGHBOURS = 2
"""Number of intervals on either side of an excess whose limits are reduced with it."""

MAX_LESS_RATIO = 4.0
"""Maximum factor by which one round reduces the limits in an interval."""

MAX_GENTLER_RAMPS = 20
"""Maximum number of times that the jerk of a ramp is reduced because the ramp exceeds a limit."""

GENTLER_RAMP_RATIO = 0.7
"""Factor by which each of these reductions multiplies the jerk."""

Excess = tuple[Array, Array]
"""u, and the ratio of usage to limit there."""

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

    ramp_time: the longest ramp of constant jerk from or to rest, s. tolerance: relative excess of
    the time over the optimum that is accepted.
    """
    ramps = _ramps(problem, bounds, ramp_time)
    if ramps is None:
        return None
    profile = bounds.profile()
    spline = _spline(problem, profile.positions, profile.speeds, profile.times, *ramps)
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
    """Return the ramps from the start (zero if it moves) and to the end."""
    way = problem.end - problem.start[0]
    ramps = []
    for end, inward in ((problem.start[0], 1.0), (problem.end, -1.0)):
        jerk = np.inf
        for _ in range(2):  # first at the end itself, then along the length of the ramp
            back = inward * min(jerk * (RAMP_VIEW * ramp_time) ** 3 / 6.0, way / 2.0)
            places = end + (0.0 if jerk == np.inf else back * _ALONG_RAMP)
            _, first, _, _ = problem.path.sample(np.atleast_1d(places))
            with np.errstate(divide='ignore'):
                slopes = problem.limits.jerk / np.abs(first)
            jerk = (1.0 - JERK_RESERVE_SHARE) * float(np.min(slopes))
        # the speed at the end of the ramp must be below the bounds nearby
        near = np.abs(bounds.positions - end) < 2.0 * jerk * ramp_time**3
        speed = float(bounds.speeds[near].min(initial=np.inf))
        longest = min((0.4 * speed / jerk) ** 0.5, (0.6 * way / jerk) ** (1.0 / 3.0))
        time = float(np.clip(longest, NODE_SPACING_S, ramp_time))
        ramp = Ramp(min(jerk, 0.6 * speed / time**2), time)
        ramps.append(_allowed_ramp(problem, ramp, end, inward))
    if problem.start[1] > 0.0:
        ramps[0] = Ramp(0.0, 0.0)
    if problem.start[0] + ramps[0].length + ramps[1].length >= problem.end:
        return None
    return ramps[0], ramps[1]


def _allowed_ramp(problem: Problem, ramp: Ramp, end: float, inward: float) -> Ramp:
    """Return a ramp, reduced if it would exceed a limit where the path bends at its end."""
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
    problem: Problem,
    us: Array,
    vs: Array,
    times: Array,
    start_ramp: Ramp,
    end_ramp: Ramp,
    spacing: float = NODE_SPACING_S,
) -> SpeedSpline | None:
    """Return a spline with nodes at equal times of a sampled timing, slightly slower."""
    begin, end = problem.start[0] + start_ramp.length, problem.end - end_ramp.length
    us = np.maximum.accumulate(us) + np.linspace(0.0, 1e-9, len(us))
    times = _slow_ends(us, times, start_ramp, end_ramp)
    first, last = np.interp([begin, end], us, times)
    count = int(np.clip((last - first) / spacing, MIN_NODES, MAX_NODES))
    nodes = np.interp(np.linspace(first, last, count + 1), times, us)
    nodes = 0.98 * nodes + 0.02 * np.linspace(begin, end, count + 1)
    nodes[0], nodes[-1] = begin, end
    nodes = _on_knots(nodes, problem.path.knots.u)
    speeds = np.interp(_middles(nodes), us, vs)
    return _of_speeds(problem, nodes, math.sqrt(0.8) * speeds, start_ramp, end_ramp)


def _finer(
    problem: Problem, spline: SpeedSpline, timing: TimeParametrisation, places: Array
) -> SpeedSpline | None:
    """Return the spline of a timing with additional nodes around the given u."""
    nodes = spline.nodes
    near = np.zeros(len(nodes) - 1, dtype=bool)
    interval = np.clip(nodes.searchsorted(places, side='right') - 1, 0, len(near) - 1)
    for beside in (-1, 0, 1):
        near[np.clip(interval + beside, 0, len(near) - 1)] = True
    nodes = np.sort(np.concatenate([nodes, ((nodes[1:] + nodes[:-1]) / 2.0)[near]]))
    speeds = np.interp(_middles(nodes), timing.positions, timing.velocities)
    return _of_speeds(problem, nodes, speeds, spline.start_ramp, spline.end_ramp)


def _of_speeds(
    problem: Problem, nodes: Array, speeds: Array, start_ramp: Ramp, end_ramp: Ramp
) -> SpeedSpline | None:
    """Return a spline with the given nodes and about these speeds at the coefficients' centres."""
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
    """Return times, extended near the ends where constant jerk from and to rest needs longer."""
    steps = np.diff(times)
    if start_ramp.time > 0.0:
        steps = np.maximum(steps, np.diff(np.cbrt(6.0 * (us - us[0]) / start_ramp.jerk)))
    steps = np.maximum(steps, -np.diff(np.cbrt(6.0 * (us[-1] - us) / end_ramp.jerk)))
    return np.append(0.0, np.cumsum(steps))


def _middles(nodes: Array) -> Array:
    """Return the place of each coefficient's maximum weight, shape (N + 2,)."""
    return np.concatenate((nodes[:1], (nodes[:-1] + nodes[1:]) / 2.0, nodes[-1:]))


def _on_knots(nodes: Array, knots: Array) -> Array:
    """Return nodes, with the nearest one moved to each knot of the path, where jerk jumps."""
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
    """Return the limits at both ends of every interval and on both sides of every path knot.

    The acceleration has no jumps there, so one side of a node bounds it below, the other above.
    """
    nodes, h, limits = spline.nodes, spline.lengths, problem.limits
    us = (nodes[:-1, None] + h[:, None] * _SAMPLES).ravel()
    weights = (h[:, None] * _WEIGHTS).ravel()
    # jerk jumps at the knots of the path: sample both sides of the knots that are not nodes
    knots = problem.path.knots.u
    knots = _few(np.setdiff1d(knots[(knots > nodes[0]) & (knots < nodes[-1])], nodes), nodes)
    us = np.concatenate((us, knots - _BESIDE, knots + _BESIDE))
    weights = np.append(weights, np.zeros(2 * len(knots)))
    interval = np.clip(nodes.searchsorted(us, side='right') - 1, 0, len(h) - 1)
    _, first, second, third = problem.path.sample(us)
    # the state at the start may itself use the whole limits
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
        problem.wanted(us - back, counted),
    )


def _few(knots: Array, nodes: Array) -> Array:
    """Return at most MAX_KNOTS knots between two nodes. The verification checks all."""
    after = nodes.searchsorted(knots)
    counts = np.bincount(after, minlength=len(nodes))
    rank = np.arange(len(knots)) - (np.cumsum(counts) - counts)[after]
    few: Array = knots[rank % -(-counts // MAX_KNOTS)[after] == 0]
    return few


def _excess(result: LimitUsage) -> Excess:
    """Return the places at which a timing exceeds the limits, and the ratios."""
    ratio = np.maximum(result.velocity, np.maximum(result.acceleration, result.jerk))
    where = ratio > 1.0
    return result.positions[where], ratio[where]


def _fraction(excess: list[Excess], nodes: Array) -> Array:
    """Return the share of the limits to use in each interval after the given excesses."""
    fraction = np.ones(len(nodes) - 1)
    for us, ratio in excess:
        where = np.clip(nodes.searchsorted(us, side='right') - 1, 0, len(fraction) - 1)
        worst = np.ones_like(fraction)
        np.maximum.at(worst, where, ratio)
        for _ in range(EXCESS_NEIGHBOURS):
            worst[1:-1] = np.maximum(worst[1:-1], np.maximum(worst[:-2], worst[2:]))
        # reduce everywhere slightly, as a reduction at one place increases the usage elsewhere
        less = np.where(worst > 1.0, EXCESS_MARGIN_RATIO, 1.0) * EXCESS_MARGIN_RATIO
        fraction /= np.minimum(less * worst, MAX_LESS_RATIO)
    return fraction
