# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A rest on the path soon, from any allowed motion.

A motion that fully uses its limits cannot always brake immediately: where the path bends, the
joints may need their whole limits to follow it. It can come to rest slightly later.
"""

import dataclasses

import numpy as np

from epson_driver.motion.smoother import optimal, ruckig_move
from epson_driver.motion.smoother.path import Knots, Path
from epson_driver.motion.smoother.problem import Problem
from epson_driver.motion.smoother.speed_bounds import SpeedBounds
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation

REACHES_IN_BRAKING_DISTANCES = (1.5, 2.0, 3.0, 4.0, 6.0)
"""Candidate distances of the rest, in multiples of the shortest braking distance by slope."""

MIN_SEGMENT_SHARE = 0.1
"""Minimum share of a segment before the rest. Below it, the rest is at the previous knot."""


def propose(problem: Problem) -> TimeParametrisation | None:
    """Return a verified timing that soon comes to rest before the path's end, or None."""
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
