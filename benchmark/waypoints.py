# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A sampled motion, and its passage times and distances at waypoints, in their order."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.motion import Array
from epson_driver.motion.interpolation import cubic

Index = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

NEAR_RAD = 0.02
"""Maximum distance of a passage from its waypoint, rad, to be a candidate besides the nearest
one."""
CLOSE_RAD = 2e-3
"""Distance within which a waypoint may be passed at the same time as the previous one, rad."""
GRID_PARTS = 16
"""Parts of a step searched for the nearest moment before the refinement."""
REFINEMENTS = 6


@dataclass(frozen=True, eq=False)
class Record:
    """Samples at equal steps of `dt` s. The first one is at rest at time 0.

    positions, velocities, accelerations: shape (k, n). costs: wall time of each step in s, shape
    (k − 1,). planned: whether the step included new points or planning, as far as known. Both may
    be empty.
    """

    dt: float
    positions: Array
    velocities: Array
    accelerations: Array
    costs: Array
    planned: Mask

    def between(self, samples: Index, shares: Array) -> Array:
        """Return positions at `shares` of the steps that start at `samples`: (m,) to (m, n).

        Cubic Hermite: exact for constant jerk, and within 1e-8 rad where the jerk jumps.
        """
        start, end = ((self.positions[i], self.velocities[i]) for i in (samples, samples + 1))
        return cubic(shares[:, None], self.dt, start, end)


@dataclass(frozen=True, eq=False)
class Passages:
    """times: (m,), s, not decreasing. distances: (m,), rad, of the joint farthest off."""

    times: Array
    distances: Array


def waypoint_passages(positions: Array, record: Record) -> Passages:
    """Return the nearest passages of waypoints (m, n) that are in order.

    Every local minimum of the distance is a candidate. One candidate per waypoint is chosen so
    that the times do not decrease and the sum of distances is minimal.
    """
    times, distances = _candidates(positions[0], record)
    totals = distances
    history: list[tuple[Array, Array, Index]] = [(times, distances, np.zeros(0, dtype=np.intp))]
    for waypoint in positions[1:]:
        before, best = history[-1][0], np.minimum.accumulate(totals)
        arg = _arg_of_minimum(totals)
        times, distances = _with_earlier(waypoint, record, before)
        last = np.searchsorted(before, times, 'right') - 1
        reachable = last >= 0
        if not reachable.any():  # the motion ended before, so its last sample is used
            times = np.array([before[-1]])
            distances = np.array([float(np.max(np.abs(record.positions[-1] - waypoint)))])
            last, reachable = np.array([len(before) - 1]), np.array([True])
        times, distances, last = times[reachable], distances[reachable], last[reachable]
        totals = distances + best[last]
        history.append((times, distances, arg[last]))
    choice = int(np.argmin(totals))
    chosen = []
    for times, distances, origin in reversed(history):
        chosen.append((times[choice], distances[choice]))
        choice = int(origin[choice]) if origin.size else 0
    result = np.array(chosen[::-1])
    return Passages(result[:, 0], result[:, 1])


def _arg_of_minimum(values: Array) -> Index:
    """Return the index of the smallest value up to each place, the first one of equal values."""
    lower = np.append(True, values[1:] < np.minimum.accumulate(values)[:-1])
    return np.maximum.accumulate(np.where(lower, np.arange(len(values)), 0))


def _candidates(waypoint: Array, record: Record) -> tuple[Array, Array]:
    """Return times and distances of all passages near a waypoint, in the order of time."""
    squares = np.einsum('kn,kn->k', record.positions - waypoint, record.positions - waypoint)
    padded = np.concatenate([[np.inf], squares, [np.inf]])
    falls, rises = squares <= padded[:-2], squares <= padded[2:]
    plateau = (squares == padded[:-2]) & (squares == padded[2:])
    minima = np.flatnonzero(falls & rises & ~plateau)
    root = np.sqrt(squares[minima])
    minima = minima[(root < NEAR_RAD) | (root <= root.min())]
    samples = np.unique(np.concatenate([minima - 1, minima]))
    samples = samples[(samples >= 0) & (samples < len(squares) - 1)]
    low, width = np.zeros(len(samples)), 1.0
    for _ in range(REFINEMENTS):
        grid = low[:, None] + width * np.arange(GRID_PARTS + 1) / GRID_PARTS
        grid = np.clip(grid, 0.0, 1.0)
        off = _offsets(waypoint, record, np.repeat(samples, GRID_PARTS + 1), grid.ravel())
        where = np.argmin(np.einsum('kn,kn->k', off, off).reshape(grid.shape), axis=1)
        low = grid[np.arange(len(samples)), where] - width / GRID_PARTS
        width = 2.0 * width / GRID_PARTS
    shares = np.clip(low + width / 2.0, 0.0, 1.0)
    off = np.abs(_offsets(waypoint, record, samples, shares))
    return record.dt * (samples + shares), off.max(axis=1)


def _with_earlier(waypoint: Array, record: Record, before: Array) -> tuple[Array, Array]:
    """Return the candidates of a waypoint, and the previous candidates that are close to it, too.

    At a sharp turn a motion may pass two close waypoints in reverse order. Then both may be
    assigned to the same moment.
    """
    times, distances = _candidates(waypoint, record)
    samples = np.minimum((before / record.dt).astype(np.intp), len(record.positions) - 2)
    off = np.abs(_offsets(waypoint, record, samples, before / record.dt - samples)).max(axis=1)
    close = off < CLOSE_RAD
    merged_times, first = np.unique(np.append(times, before[close]), return_index=True)
    return merged_times, np.append(distances, off[close])[first]


def _offsets(waypoint: Array, record: Record, samples: Index, shares: Array) -> Array:
    return record.between(samples, shares) - waypoint


def may_be_merged(positions: Array, tolerance: float) -> Mask:
    """Return which waypoints a smoother may drop, shape (m,), because a kept one is close.

    A waypoint may be dropped within `tolerance` (rad, each joint) of a neighbour, or of an earlier
    point from which the path has not departed by more since. The first and the last are never
    dropped.
    """
    count = len(positions)
    result = np.zeros(count, dtype=np.bool_)
    anchor = positions[0]
    for index in range(1, count):
        near_anchor = np.max(np.abs(positions[index] - anchor)) <= tolerance
        near_before = np.max(np.abs(positions[index] - positions[index - 1])) <= tolerance
        result[index] = near_anchor or near_before
        if not near_anchor:
            anchor = positions[index]
    # the last point replaces a kept one right before it
    result[:-1] |= np.max(np.abs(positions[:-1] - positions[-1]), axis=1) <= tolerance
    result[0] = result[-1] = False
    return result
