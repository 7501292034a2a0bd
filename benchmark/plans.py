# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Plans like a motion planner's: a blended polyline, with a timing without a jerk limit.

The timing is the fastest one within velocity and acceleration limits (like TOTG and TOPP-RA), from
forward and backward passes over the path. So it starts and ends at rest, and its acceleration
jumps.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array

GRID_INTERVALS = 4000
"""Number of path intervals over which a timing is integrated."""


@dataclass(frozen=True, eq=False)
class TimedPath:
    """A path sampled densely in time: times (m,), s, increasing from 0; positions (m, n), rad."""

    times: Array
    positions: Array

    @property
    def duration(self) -> float:
        """Time from rest to rest, s."""
        return float(self.times[-1])

    def at(self, times: Array) -> Array:
        """Return the positions at some times, shape (len(times), n)."""
        columns = [np.interp(times, self.times, column) for column in self.positions.T]
        return np.stack(columns, axis=1)


def random_vias(rng: np.random.Generator, count: int, low: Array, high: Array) -> Array:
    """Return `count` poses inside a box, each within reach of the one before, shape (count, n)."""
    vias = [rng.uniform(low, high)]
    for _ in range(count - 1):
        step = rng.uniform(-0.45, 0.45, low.size) * (high - low)
        vias.append(np.clip(vias[-1] + step, low, high))
    return np.array(vias)


def blended(vias: Array, blend: float) -> Array:
    """Return a dense path along the polyline of the vias, shape (GRID_INTERVALS + 1, n).

    Its steps are of equal length. Corners become parabolas that start `blend` rad before them, at
    most halfway.
    """
    pieces = [vias[:1]]
    for before, corner, after in zip(vias, vias[1:], vias[2:], strict=False):
        into, out = before - corner, after - corner
        a, b = (min(blend / float(np.linalg.norm(side)), 0.5) for side in (into, out))
        t = np.linspace(0.0, 1.0, 400)[:, None]
        pieces.append(
            (1 - t) ** 2 * (corner + a * into)
            + t**2 * (corner + b * out)
            + 2 * t * (1 - t) * corner
        )
    pieces.append(vias[-1:])
    points = np.concatenate(pieces)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0.0, lengths[-1], GRID_INTERVALS + 1)
    return np.stack([np.interp(at, lengths, column) for column in points.T], axis=1)


def fastest_timing(path: Array, velocity: Array, acceleration: Array) -> TimedPath:
    """Return the fastest timing of a dense path (m, n) from rest to rest within two limits (n,).

    x = ṡ² over the path's index s: each joint's acceleration is q′·x′/2 + q″·x.
    """
    first = np.gradient(path, axis=0)
    second = np.gradient(first, axis=0)
    with np.errstate(divide='ignore'):
        cap = np.min((velocity / np.abs(first)) ** 2, axis=1)
        # room for the curve itself, so that both passes find an acceleration that is allowed
        cap = np.minimum(cap, np.min(0.7 * acceleration / np.abs(second), axis=1))
    forward = _pass(cap, first, second, acceleration)
    backward = _pass(cap[::-1], -first[::-1], second[::-1], acceleration)[::-1]
    speed = np.sqrt(np.minimum(forward, backward))
    times = np.concatenate([[0.0], np.cumsum(2.0 / (speed[1:] + speed[:-1]))])
    return TimedPath(times, path)


def _pass(cap: Array, first: Array, second: Array, acceleration: Array) -> Array:
    x = np.empty_like(cap)
    x[0] = 0.0
    for i in range(len(cap) - 1):
        with np.errstate(divide='ignore', invalid='ignore'):
            rate = (acceleration - np.abs(second[i]) * x[i]) / np.abs(first[i])
        x[i + 1] = min(cap[i + 1], x[i] + 2.0 * max(float(np.nanmin(rate)), 0.0))
    return x
