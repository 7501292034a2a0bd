# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The grids on which a speed law is optimised, and the law that the search starts from."""

import numpy as np

from benchmark.optimum.speed_law import SpeedLaw, greville
from benchmark.spline_path import SplinePath
from epson_driver.motion import Array, JointLimits

LAUNCH = 0.004
"""Duration of a launch at the first guess, s."""
STEP = 0.002
"""Step of the grid in time, s."""
FINEST = 300
"""The grid has at least so many intervals in the time of a whole motion."""
GRADE = 0.02
"""Near both ends the step is this share of the time from rest: the speed grows fast there."""
MOST = 3000
"""And about so many at most: the first, slow laws would have ten times more."""


def first_law(path: SplinePath, limits: JointLimits) -> SpeedLaw:
    """Return a law of one shape for every path; how fast it is means nothing."""
    _, first, _, _ = path.at(np.array([0.0, path.length]))
    jerks = np.min(limits.jerk / np.abs(first).clip(1e-9), axis=1)
    launch, landing = (min(float(jerk) * LAUNCH**3 / 6.0, 0.01 * path.length) for jerk in jerks)
    half = path.length / 2
    rise, fall = (np.geomspace(end, half, 200) for end in (launch, landing))
    breaks = np.concatenate([rise, path.length - fall[-2::-1]])
    at = greville(breaks)
    x = np.minimum(at, path.length - at) ** (4 / 3) / (1.0 + 3.0 * at * (path.length - at))
    return joined(breaks, x, path.length)


def joined(breaks: Array, coefficients: Array, length: float) -> SpeedLaw:
    """Return a law whose slope meets those of launch and landing."""
    begin, end = joints(breaks, length)
    coefficients = coefficients.copy()
    coefficients[1] = begin * coefficients[0]
    coefficients[-2] = end * coefficients[-1]
    return SpeedLaw(breaks, coefficients, length)


def joints(breaks: Array, length: float) -> tuple[float, float]:
    """Return the ratio of the second coefficient to the first, and that at the other end."""
    begin = 1.0 + 2.0 * (breaks[1] - breaks[0]) / (3.0 * breaks[0])
    end = 1.0 + 2.0 * (breaks[-1] - breaks[-2]) / (3.0 * (length - breaks[-1]))
    return float(begin), float(end)


def regridded(law: SpeedLaw) -> SpeedLaw:
    """Return nearly the same law over equal steps of time, finer where it starts and ends."""
    times = law.times_at_breaks()
    launched, landing = float(times[0]), law.duration - float(times[-1])
    step = max(min(STEP, law.duration / FINEST), law.duration / MOST)
    middle = (launched + float(times[-1])) / 2.0
    rise = _graded(launched, middle, step)
    fall = law.duration - _graded(landing, law.duration - middle, step)[::-1]
    if fall[0] - rise[-1] < 0.5 * step:
        fall = fall[1:]
    breaks = law.parameters_at(np.concatenate([rise, fall]))
    breaks[0], breaks[-1] = law.breaks[0], law.breaks[-1]
    x, _, _ = law.at(greville(breaks))
    return joined(breaks, x, law.length)


def _graded(first: float, last: float, step: float) -> Array:
    """Return times from `first` to before `last` in steps that grow with them up to `step`."""
    stamps = [first]
    while stamps[-1] < last:
        stamps.append(stamps[-1] + min(step, GRADE * stamps[-1]))
    return np.array(stamps[:-1])
