# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Position and time of a sampled motion's passage of its waypoints."""

from math import ceil

import numpy as np
import numpy.typing as npt

from epson_driver.motion.interpolation import cubic
from epson_driver.motion.limits import Array
from epson_driver.motion.trajectory import Trajectory

MAX_COMPARED_PAIRS = 25_000_000
"""Maximum pairs of a waypoint and a sample compared together: 4 bytes each."""

Indices = npt.NDArray[np.intp]


def passages(waypoints: Array, positions: Array) -> Indices:
    """Return the sample that is nearest to each waypoint: (n, m) and (k, m) to (n,).

    The passages are in the waypoints' order and together the nearest possible (dynamic
    programming over waypoints and samples), so that a path may cross itself.
    """
    samples = np.arange(len(positions))
    came_from = np.empty((len(waypoints), len(samples)), dtype=np.int32)
    cost = np.zeros(len(samples))
    for index, waypoint in enumerate(waypoints):
        lowest = np.minimum.accumulate(cost)
        came_from[index] = np.maximum.accumulate(np.where(cost <= lowest, samples, 0))
        cost = lowest + np.abs(positions - waypoint).max(axis=1)
    passed = [int(np.argmin(cost))]
    for index in range(len(waypoints) - 1, 0, -1):
        passed.append(int(came_from[index, passed[-1]]))
    passed.reverse()
    return np.array(passed)


def passed(waypoints: Array, motion: Trajectory) -> tuple[Array, Array]:
    """Return a motion's distance from each waypoint, rad, and its time, s, shapes (n,).

    Between two samples the motion is the cubic with their positions and velocities. Raises
    ValueError for a motion without velocities.
    """
    if motion.velocities is None:
        raise ValueError('the motion has no velocities')
    samples = _sparing_passages(waypoints, motion.positions)
    errors = np.abs(motion.positions[samples] - waypoints).max(axis=1)
    times = motion.times[samples]
    for index, (waypoint, sample) in enumerate(zip(waypoints, samples.tolist(), strict=True)):
        for first in (sample - 1, sample):
            if 0 <= first < len(motion.times) - 1:
                error, time = _nearest(waypoint, motion, motion.velocities, first)
                if error < errors[index]:
                    errors[index], times[index] = error, time
    return errors, times


def _sparing_passages(waypoints: Array, positions: Array) -> Indices:
    """Return passages. For long motions, search every n-th sample first, then refine."""
    stride = ceil(len(waypoints) * len(positions) / MAX_COMPARED_PAIRS)
    found = passages(waypoints, positions[::stride]) * stride
    if stride == 1:
        return found
    for index, (waypoint, sample) in enumerate(zip(waypoints, found.tolist(), strict=True)):
        first = max(sample - stride, 0)
        near = positions[first : sample + stride + 1]
        found[index] = first + int(np.argmin(np.abs(near - waypoint).max(axis=1)))
    return found


def _nearest(
    waypoint: Array, motion: Trajectory, velocities: Array, first: int
) -> tuple[float, float]:
    """Return the smallest distance to a waypoint between two adjacent samples, and its time."""
    dt = float(motion.times[first + 1] - motion.times[first])
    begin, end = ((motion.positions[i] - waypoint, velocities[i]) for i in (first, first + 1))
    low, high = 0.0, 1.0
    for _ in range(3):  # each time between the neighbours of the best of 41 places
        s = np.linspace(low, high, 41)
        distances = np.abs(cubic(s[:, None], dt, begin, end)).max(axis=1)
        best = int(np.argmin(distances))
        low, high = float(s[max(best - 1, 0)]), float(s[min(best + 1, 40)])
    return float(distances[best]), float(motion.times[first] + s[best] * dt)
