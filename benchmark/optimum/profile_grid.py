# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The grids on which a speed profile is optimised, and the profile that the search starts from."""

import numpy as np

from benchmark.optimum.speed_profile import SpeedProfile, greville
from benchmark.spline_path import SplinePath
from epson_driver.motion import Array, JointLimits

FIRST_RAMP_S = 0.004
"""Duration of a start ramp at the first guess, s."""
MAX_GRID_STEP_S = 0.002
"""Step of the grid in time, s."""
MIN_INTERVALS = 300
"""The grid has at least so many intervals in the time of a whole motion."""
END_STEP_SHARE = 0.02
"""Near both ends the step is this share of the time from rest: the speed grows fast there."""
MAX_INTERVALS = 3000
"""And about so many at most: the first, slow profiles would have ten times more."""


def first_profile(path: SplinePath, limits: JointLimits) -> SpeedProfile:
    """Return a profile of one shape for every path; how fast it is means nothing."""
    _, first, _, _ = path.at(np.array([0.0, path.length]))
    jerks = np.min(limits.jerk / np.abs(first).clip(1e-9), axis=1)
    start_ramp, end_ramp = (
        min(float(jerk) * FIRST_RAMP_S**3 / 6.0, 0.01 * path.length) for jerk in jerks
    )
    half = path.length / 2
    rise, fall = (np.geomspace(end, half, 200) for end in (start_ramp, end_ramp))
    breaks = np.concatenate([rise, path.length - fall[-2::-1]])
    at = greville(breaks)
    x = np.minimum(at, path.length - at) ** (4 / 3) / (1.0 + 3.0 * at * (path.length - at))
    return joined(breaks, x, path.length)


def joined(breaks: Array, coefficients: Array, length: float) -> SpeedProfile:
    """Return a profile whose slope meets those of start ramp and end ramp."""
    begin, end = joints(breaks, length)
    coefficients = coefficients.copy()
    coefficients[1] = begin * coefficients[0]
    coefficients[-2] = end * coefficients[-1]
    return SpeedProfile(breaks, coefficients, length)


def joints(breaks: Array, length: float) -> tuple[float, float]:
    """Return the ratio of the second coefficient to the first, and that at the other end."""
    begin = 1.0 + 2.0 * (breaks[1] - breaks[0]) / (3.0 * breaks[0])
    end = 1.0 + 2.0 * (breaks[-1] - breaks[-2]) / (3.0 * (length - breaks[-1]))
    return float(begin), float(end)


def regridded(profile: SpeedProfile) -> SpeedProfile:
    """Return nearly the same profile over equal steps of time, finer where it starts and ends."""
    times = profile.times_at_breaks()
    started, end_ramp = float(times[0]), profile.duration - float(times[-1])
    step = max(
        min(MAX_GRID_STEP_S, profile.duration / MIN_INTERVALS), profile.duration / MAX_INTERVALS
    )
    middle = (started + float(times[-1])) / 2.0
    rise = _graded(started, middle, step)
    fall = profile.duration - _graded(end_ramp, profile.duration - middle, step)[::-1]
    if fall[0] - rise[-1] < 0.5 * step:
        fall = fall[1:]
    breaks = profile.parameters_at(np.concatenate([rise, fall]))
    breaks[0], breaks[-1] = profile.breaks[0], profile.breaks[-1]
    x, _, _ = profile.at(greville(breaks))
    return joined(breaks, x, profile.length)


def _graded(first: float, last: float, step: float) -> Array:
    """Return times from `first` to before `last` in steps that grow with them up to `step`."""
    stamps = [first]
    while stamps[-1] < last:
        stamps.append(stamps[-1] + min(step, END_STEP_SHARE * stamps[-1]))
    return np.array(stamps[:-1])
