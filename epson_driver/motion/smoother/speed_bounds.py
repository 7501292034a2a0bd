# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fastest speeds on a path, which mostly ignore the jerk limits. `optimal` starts from them.

u is the path parameter, x = u̇² the square of the speed, and q″, q‴ are the second and third
derivative of the joint positions with respect to u. The method integrates dx/du = 2ü, once
backward and once forward (Bobrow et al. 1985).
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion.limits import Array
from epson_driver.motion.smoother.request import Problem

ACCELERATION_SHARE = 0.8
CURVATURE_SHARE = 0.7
"""ACCELERATION_SHARE: fraction of the acceleration limit that is used. CURVATURE_SHARE: fraction
of the acceleration limit that q″u̇² alone may use, and of the jerk limit that q‴u̇³ may use."""

MIN_SAMPLES = 160
"""Minimum number of samples of a path. There are at least two per segment."""

MANY_KNOTS = 400
"""Number of knots above which there is one sample per segment."""


@dataclass(frozen=True, slots=True, eq=False)
class SpeedProfile:
    """Speeds u̇ at path parameters u, and the times from the first u to each u, s, shapes (m,)."""

    positions: Array
    speeds: Array
    times: Array


class SpeedBounds:
    """Upper bounds of the speed u̇ along a path.

    * positions: path parameters, shape (m,).
    * speeds: the bounds at these parameters, shape (m,).
    """

    __slots__ = ('_max_acceleration', '_start', 'positions', 'speeds')

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
            problem.target_speeds(us, first), np.minimum(np.sqrt(curvature), np.cbrt(twist))
        )
        # at the speed bound, the part of the acceleration that the curvature leaves for ü
        remaining = ACCELERATION_SHARE * limits.acceleration
        remaining = remaining - np.abs(second) * self.speeds[:, None] ** 2
        with np.errstate(divide='ignore'):
            self._max_acceleration = np.min(remaining / np.abs(first), axis=1)

    def profile(self) -> SpeedProfile:
        """Return the fastest speeds from the initial state to rest at the end of the path.

        If the initial speed exceeds the bounds, the profile starts with maximum braking.
        """
        start, start_speed, _ = self._start
        ahead = self.positions > start + 1e-12
        us = np.concatenate(([start], self.positions[ahead]))
        acceleration = self._max_acceleration[ahead]
        acceleration = np.concatenate((acceleration[:1], acceleration))
        gain = 2.0 * np.diff(us) * np.minimum(acceleration[:-1], acceleration[1:])
        gain = gain.tolist()
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
    count = 1 if len(knots) > MANY_KNOTS else max(2, -(-MIN_SAMPLES // (len(knots) - 1)))
    inside = np.arange(count) / count
    us = knots[:-1, None] + np.diff(knots)[:, None] * inside
    return np.concatenate((us.ravel(), knots[-1:]))
