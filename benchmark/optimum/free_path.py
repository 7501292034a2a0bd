# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""OPT where the path is free between the waypoints: the fastest motion found.

The paths are those that the smoother's own search for a better one finds, without its bound on
effort: with several distances of the speed's nodes, and as near to the straight ways as the
smoother stays, and as far from them as it likes. On the best of them two timings are compared: the
smoother's own, with the reserves that it keeps, and `jerk_limited_optimum`. Both end at a local
optimum, and either may be the faster one. What is used of the limits is found out without the
smoother's verification.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmark.optimum.jerk_limited import jerk_limited_optimum
from benchmark.spline_path import SplinePath, merged
from epson_driver.motion import Array, JointLimits
from epson_driver.motion.smoother import optimal
from epson_driver.motion.smoother.effort import Effort
from epson_driver.motion.smoother.path import Knots, Path, through
from epson_driver.motion.smoother.problem import Problem
from epson_driver.motion.smoother.refinement import refined
from epson_driver.motion.smoother.refinement_rows import BEND_RATIO, Freedom
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation

MAX_WAYPOINTS = 60
"""More of them than that are so near to each other that the path has little to choose."""

NODE_SPACINGS_S = (0.006, 0.010, 0.016, 0.024)
"""Time between the nodes of the speed while the path is searched, s: one start of each."""
BEND_RATIOS = (BEND_RATIO, 3.0, 1e3)
"""How far from the straight way a path may be, as a multiple of the spline: one start of each."""
ROUNDS = 5
"""Each round of a start begins with the path of the one before, as long as that gets faster."""
SAMPLE_STEP_S = 1e-4
"""Time between two positions of which the use of the limits is found out, s."""
CANDIDATES = 2
"""Of so many of the fastest paths the optimum is computed."""


@dataclass(frozen=True)
class FreeOptimum:
    """How long the fastest motion takes, s, and the largest |v|/V, |a|/A, |j|/J in it."""

    duration: float
    velocity: float
    acceleration: float
    jerk: float


def free_path_optimum(positions: Array, limits: JointLimits) -> FreeOptimum | None:
    """Return the fastest motion found through points (n, joints), rad, or None if there is none.

    Its path stays within the position limits everywhere. None for more than MAX_WAYPOINTS points.
    """
    points = merged(positions)
    if not 2 < len(points) <= MAX_WAYPOINTS:
        return None
    found = sorted(_candidates(points, limits), key=lambda one: one[1].duration)[:CANDIDATES]
    motions = [_executed(path, timing, limits) for path, timing in found]
    for path, _ in found:
        best = jerk_limited_optimum(_polynomials(path), limits)
        duration = best.profile.duration
        motions.append(FreeOptimum(duration, best.velocity, best.acceleration, best.jerk))
    return min(motions, key=lambda one: one.duration, default=None)


def _polynomials(path: Path) -> SplinePath:
    """Return a path of the smoother as the benchmark has paths."""
    knots = path.knots.u
    polynomials = path.taylor(np.arange(len(knots) - 1), np.zeros(len(knots) - 1))
    return SplinePath(knots, np.moveaxis(polynomials, 1, 0)[::-1])


def _executed(path: Path, timing: TimeParametrisation, limits: JointLimits) -> FreeOptimum:
    """Return what a timing from rest to rest uses of the limits: differences of its positions."""
    step = timing.duration / round(timing.duration / SAMPLE_STEP_S)
    times = np.arange(-3, round(timing.duration / step) + 4) * step
    us = timing.sample(np.clip(times, 0.0, timing.duration))[0]
    positions = path.sample(us)[0]
    used = (
        float(np.max(np.abs(np.diff(positions, order, axis=0)) / step**order / limit))
        for order, limit in enumerate((limits.velocity, limits.acceleration, limits.jerk), 1)
    )
    return FreeOptimum(timing.duration, *used)


def _candidates(points: Array, limits: JointLimits) -> Iterator[tuple[Path, TimeParametrisation]]:
    """Yield paths, and the smoother's timing on each."""
    rest = np.zeros_like(points[:1])
    spline = through(Knots(np.zeros(1), points[:1], rest, rest), points[1:], limits, False, True)
    first = _timing(spline, limits)
    if first is None:
        return
    free = np.ones((len(points), 3), dtype=bool)
    free[:, 0] = False
    for spacing, ratio in product(NODE_SPACINGS_S, BEND_RATIOS):
        freedom = Freedom(free, points, np.zeros(len(points)), spline, ratio)
        path, timing = spline, first
        for _ in range(ROUNDS):
            problem = _problem(path, limits)
            better = refined(problem, SpeedBounds(problem), timing, freedom, spacing)
            if better is None or better.outside(limits).any():
                break
            faster = _timing(better, limits)
            if faster is None or faster.duration >= timing.duration:
                break
            path, timing = better, faster
            yield path, timing


def _problem(path: Path, limits: JointLimits) -> Problem:
    return Problem(path, (0.0, 0.0, 0.0), limits, effort=Effort(np.inf))


def _timing(path: Path, limits: JointLimits) -> TimeParametrisation | None:
    problem = _problem(path, limits)
    return optimal.propose(problem, SpeedBounds(problem))
