# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The times at which a sampled motion passes waypoints, and its distances from them."""

from math import ceil

import numpy as np
import numpy.typing as npt

from epson_driver.motion.interpolation import cubic
from epson_driver.motion.limits import Array
from epson_driver.motion.trajectory import Trajectory

MAX_COMPARED_PAIRS = 25_000_000
"""Maximum number of pairs of a waypoint and a sample. For more pairs, some samples are skipped.
A pair needs 4 bytes."""

Indices = npt.NDArray[np.intp]


def closest_sample_indices(waypoints: Array, positions: Array) -> Indices:
    """Return the index of the sample at which a motion passes each waypoint, shape (n,).

    waypoints: shape (n, m). positions: the samples, shape (k, m). Among all indices that do not
    decrease, the result has the smallest sum of distances between waypoints and samples (dynamic
    programming). So the order of the waypoints is respected if the path crosses itself.
    """
    samples = np.arange(len(positions))
    predecessor = np.empty((len(waypoints), len(samples)), dtype=np.int32)
    cost = np.zeros(len(samples))
    for index, waypoint in enumerate(waypoints):
        lowest = np.minimum.accumulate(cost)
        predecessor[index] = np.maximum.accumulate(np.where(cost <= lowest, samples, 0))
        cost = lowest + np.abs(positions - waypoint).max(axis=1)
    passed = [int(np.argmin(cost))]
    for index in range(len(waypoints) - 1, 0, -1):
        passed.append(int(predecessor[index, passed[-1]]))
    passed.reverse()
    return np.array(passed)


def passed(waypoints: Array, motion: Trajectory) -> tuple[Array, Array]:
    """Return the smallest distance of a motion from each waypoint, rad, and its time, s.

    Both have shape (n,). A distance is the largest difference in any joint. Between samples the
    motion is cubic. Raises ValueError if the motion has no velocities.
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
    """Return the index of each waypoint's closest sample.

    In a long motion, only some samples are compared first, and then the neighbours of the result.
    """
    stride = ceil(len(waypoints) * len(positions) / MAX_COMPARED_PAIRS)
    result = closest_sample_indices(waypoints, positions[::stride]) * stride
    if stride == 1:
        return result
    for index, (waypoint, sample) in enumerate(zip(waypoints, result.tolist(), strict=True)):
        first = max(sample - stride, 0)
        near = positions[first : sample + stride + 1]
        result[index] = first + int(np.argmin(np.abs(near - waypoint).max(axis=1)))
    return result


def _nearest(
    waypoint: Array, motion: Trajectory, velocities: Array, first: int
) -> tuple[float, float]:
    """Return the smallest distance to a waypoint between two samples, and its time.

    first: index of the first of the two samples.
    """
    dt = float(motion.times[first + 1] - motion.times[first])
    start, end = ((motion.positions[i] - waypoint, velocities[i]) for i in (first, first + 1))
    low, high = 0.0, 1.0
    for _ in range(3):  # refine between the neighbours of the best of 41 positions
        s = np.linspace(low, high, 41)
        distances = np.abs(cubic(s[:, None], dt, start, end)).max(axis=1)
        best = int(np.argmin(distances))
        low, high = float(s[max(best - 1, 0)]), float(s[min(best + 1, 40)])
    return float(distances[best]), float(motion.times[first] + s[best] * dt)
