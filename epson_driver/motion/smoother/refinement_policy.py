# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A faster plan through the same waypoints, where these are so far apart that the path has a say.

Nothing can be lost: the better path counts only if a verified timing on it takes less time.
"""

import dataclasses

import numpy as np

from epson_driver.motion.limits import JointLimits
from epson_driver.motion.smoother import optimal
from epson_driver.motion.smoother.effort import OUTSET_US, Effort
from epson_driver.motion.smoother.path import AT_LIMIT_DISTANCE, Path, through
from epson_driver.motion.smoother.problem import Problem
from epson_driver.motion.smoother.refinement import refined
from epson_driver.motion.smoother.refinement_rows import Freedom
from epson_driver.motion.smoother.request import Request
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation

MIN_SPACING_SHARE = 0.3
"""Mean time between two waypoints, in A/J, from which on a better path is looked for: less than
that apart they leave little to choose."""

MANY_WAYPOINTS, NEARER_SHARE = 10, 0.7
"""Where so many waypoints are sparse and within the horizon of a plan, it looks that much less far
ahead: a better path for the next ones is worth more than a plan for all of them."""

NEIGHBOUR_SHARE = 0.25
"""A path passes a waypoint within this share of the way to its neighbours, whatever the tolerance:
it must not leave the order of the points."""

REFINEMENT_SHARE = 0.75
"""Of the effort that is left, for the path; the rest is for the timing on it."""


def improves(request: Request) -> bool:
    """Return whether to refine the path: only where nothing but the limits says how fast."""
    return request.refine and not request.timed.any()


def nearer(request: Request, path: Path, limits: JointLimits) -> Request:
    """Return the request, with a nearer horizon if a path has many sparse waypoints within it."""
    ahead = len(path.knots.u) - 1 - path.segment(request.state[0])
    if not improves(request) or ahead <= MANY_WAYPOINTS:
        return request
    if request.horizon < ahead * _least_spacing(limits):
        return request
    return dataclasses.replace(request, horizon=NEARER_SHARE * request.horizon)


def _least_spacing(limits: JointLimits) -> float:
    return MIN_SPACING_SHARE * float(np.max(limits.acceleration / limits.jerk))


def faster(
    request: Request,
    problem: Problem,
    bounds: SpeedBounds,
    timing: TimeParametrisation,
    effort: Effort,
) -> tuple[Path, TimeParametrisation]:
    """Return a path through the problem's knots and a verified timing on it: a faster, or these.

    timing: one of the problem's, to its end.
    """
    path, limits = problem.path, problem.limits
    begin = path.segment(problem.start[0])
    if not improves(request) or effort.used_up:
        return path, timing
    if timing.duration < _least_spacing(limits) * (len(path.knots.u) - 1 - begin):
        return path, timing
    mine = effort.part(REFINEMENT_SHARE)
    freedom = _freedom(request, path, limits)
    better = refined(dataclasses.replace(problem, effort=mine), bounds, timing, freedom)
    effort.back(mine)
    if better is None or effort.used_up or better.outside(limits)[begin:].any():
        return path, timing
    effort.spend(OUTSET_US)
    again = dataclasses.replace(problem, path=better, effort=effort, former=None)
    found = optimal.propose(again, SpeedBounds(again))
    if found is None or found.duration >= timing.duration:
        return path, timing
    return better, found


def _freedom(request: Request, path: Path, limits: JointLimits) -> Freedom:
    """Return what may change: all but the knots that are kept, the ends, and those on a border."""
    knots = path.knots
    count, kept = len(knots.u), len(request.kept.u)
    free = np.ones((count, 3), dtype=bool)
    free[[0, -1], 0] = False
    centre = np.concatenate([request.kept.position, request.points])[:count]
    ways = np.append(np.abs(np.diff(centre, axis=0)).max(axis=1), np.inf)
    tolerance = np.minimum(request.tolerance, NEIGHBOUR_SHARE * np.minimum(ways, np.roll(ways, 1)))
    free[:, 0] &= tolerance > 0.0
    if kept > 1:
        free[:kept] = False
    cut = count < kept + len(request.points)
    if cut or not request.whole:
        free[-1] = False  # the path must be able to go on from there
    border = (knots.position < limits.position_min + AT_LIMIT_DISTANCE) | (
        knots.position > limits.position_max - AT_LIMIT_DISTANCE
    )
    free[border.any(axis=1)] = False
    # not the path itself: what was better before would be allowed to bend still more
    spline = through(knots[:1], knots.position[1:], limits, clamped=False, final=True)
    return Freedom(free, centre, tolerance, spline)
