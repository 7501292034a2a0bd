# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Rest on the path soon, out of any motion that is allowed.

A motion that uses its limits to the full can not always brake at once: where the path bends, the
joints may need all they have to follow it. It can rest a little later.
"""

import dataclasses

import numpy as np

from epson_driver.motion.smoother import optimal, ruckig_move
from epson_driver.motion.smoother.path import Knots, Path
from epson_driver.motion.smoother.problem import Problem
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation

REACHES_IN_BRAKING_DISTANCES = (1.5, 2.0, 3.0, 4.0, 6.0)
"""Where to rest: in ways of the hardest braking that the path's slope alone would allow."""

MIN_SEGMENT_SHARE = 0.1
"""Less of a segment than this is left out: the rest is at the knot before."""


def propose(problem: Problem) -> TimeParametrisation | None:
    """Return a verified timing that soon rests before the path's end, or None."""
    timing = ruckig_move.stop(problem)
    if timing is not None:
        return timing
    hardest = ruckig_move.gentle_stop(problem.start, problem.path, problem.limits, 1.0)
    if hardest is None:
        return None
    begin = problem.start[0]
    for reach in REACHES_IN_BRAKING_DISTANCES:
        end = begin + reach * (hardest.end - begin)
        if not begin < end < problem.end:
            return None
        timing = _rest_at(problem, _until(problem.path, begin, end))
        if timing is not None:
            return timing
    return None


def _rest_at(problem: Problem, path: Path) -> TimeParametrisation | None:
    """Return the fastest timing to the end of a part of the path."""
    shorter = dataclasses.replace(problem, path=path, commanded=None)
    timing = optimal.propose(shorter, SpeedBounds(shorter))
    if timing is None or not problem.usage(timing).allowed:
        return None
    return timing


def _until(path: Path, begin: float, end: float) -> Path:
    """Return the path from the segment of `begin` to `end`, or to a knot just before."""
    knots = path.knots
    first, last = path.segment(begin), path.segment(end)
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
