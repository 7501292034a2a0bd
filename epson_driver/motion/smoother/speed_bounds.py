# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fastest speeds on a path without regard to jerk: the starting point of `optimal`.

One pass backward and one forward over dx/du = 2ü for x = u̇² (Bobrow et al. 1985).
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion.limits import Array
from epson_driver.motion.smoother.request import Problem

ACCELERATION_SHARE = 0.8
CURVATURE_SHARE = 0.7
"""Shares of the acceleration limit: for the total acceleration, and for q″u̇² alone."""

MIN_SAMPLES = 160
"""Minimum samples per path, with at least two per segment."""

MANY_KNOTS = 400
"""Number of knots from which one sample per segment is enough."""


@dataclass(frozen=True, slots=True, eq=False)
class SpeedProfile:
    """u̇ at samples of u, and the time from the first sample, shapes (m,)."""

    positions: Array
    speeds: Array
    times: Array


class SpeedBounds:
    """The samples of one problem's path, and the speed bounds there, shapes (m,)."""

    __slots__ = ('_left', '_start', 'positions', 'speeds')

    def __init__(self, problem: Problem) -> None:
        self._start = problem.start
        us = _samples(problem)
        _, first, second, third = problem.path.sample(us)
        limits = problem.limits
        with np.errstate(divide='ignore'):
            curvature = np.min(CURVATURE_SHARE * limits.acceleration / np.abs(second), axis=1)
            twist = np.min(CURVATURE_SHARE * limits.jerk / np.abs(third), axis=1)
        self.positions = us
        self.speeds = np.minimum(
            problem.wanted(us, first), np.minimum(np.sqrt(curvature), np.cbrt(twist))
        )
        # acceleration left for ü beside curvature, at the bound (conservative below it)
        bend = np.abs(second) * self.speeds[:, None] ** 2
        left = ACCELERATION_SHARE * limits.acceleration - bend
        with np.errstate(divide='ignore'):
            self._left = np.min(left / np.abs(first), axis=1)

    def profile(self) -> SpeedProfile:
        """Return the fastest speeds from the problem's start to rest at its end.

        A start above the bounds is followed by maximum braking.
        """
        start, start_speed, _ = self._start
        ahead = self.positions > start + 1e-12
        us = np.concatenate(([start], self.positions[ahead]))
        pace = self._left[ahead]
        pace = np.concatenate((pace[:1], pace))
        gain = (2.0 * np.diff(us) * np.minimum(pace[:-1], pace[1:])).tolist()
        x = [start_speed**2, *(self.speeds[ahead] ** 2).tolist()]
        x[-1] = 0.0
        for i in range(len(gain) - 1, 0, -1):
            if x[i + 1] + gain[i] < x[i]:
                x[i] = x[i + 1] + gain[i]
        for i, more in enumerate(gain):
            if x[i] + more < x[i + 1]:
                x[i + 1] = x[i] + more
        speeds = np.sqrt(x)
        steps = 2.0 * np.diff(us) / np.maximum(speeds[1:] + speeds[:-1], 1e-9)
        return SpeedProfile(us, speeds, np.concatenate(([0.0], np.cumsum(steps))))


def _samples(problem: Problem) -> Array:
    knots = problem.path.knots.u
    first = problem.path.segment(problem.start[0])
    knots = np.concatenate(([problem.start[0]], knots[first + 1 :]))
    item = max(2, -(-MIN_SAMPLES // (len(knots) - 1)))
    if len(knots) > MANY_KNOTS:
        item = 1
    inside = np.arange(item) / item
    us = knots[:-1, None] + np.diff(knots)[:, None] * inside
    return np.concatenate((us.ravel(), knots[-1:]))
