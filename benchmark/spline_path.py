# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The geometric path on which the bounds are computed: one cubic spline through all points."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from benchmark.arrays import Index
from epson_driver.motion import Array

MERGE_TOLERANCE_RAD = 5e-4
"""A point may be missed by as much, rad, if it lies that close to another one."""


def merged(positions: Array, tolerance: float = MERGE_TOLERANCE_RAD / 2) -> Array:
    """Return the points without those that are closer than `tolerance` to the last kept one.

    Shapes (n, joints) and (m, joints), rad, largest difference of a joint. The last point is
    always the end: it takes the place of a kept one that is too close to it.
    """
    kept = [positions[0]]
    for point in positions[1:]:
        if np.max(np.abs(point - kept[-1])) >= tolerance:
            kept.append(point)
    if np.any(kept[-1] != positions[-1]):
        if len(kept) > 1:
            kept.pop()
        kept.append(positions[-1])
    return np.array(kept)


@dataclass(frozen=True, eq=False)
class SplinePath:
    """A path q(u), 0 ≤ u ≤ length, of polynomials: a natural C2 cubic spline by `spline_path`.

    u is chord length with every joint measured in its own velocity limit, so u is about the time
    in s that the way would take at full speed. knots: shape (m,); coefficients of u - knot: shape
    (degree + 1, m − 1, n), the highest power first.
    """

    knots: Array
    coefficients: Array

    @property
    def length(self) -> float:
        """The end of the parameter, s at full speed."""
        return float(self.knots[-1])

    def pieces(self, u: Array) -> Index:
        """Return the index of the piece each parameter lies on, shape (k,)."""
        return np.clip(np.searchsorted(self.knots, u, 'right') - 1, 0, len(self.knots) - 2)

    def at(self, u: Array, pieces: Index | None = None) -> tuple[Array, Array, Array, Array]:
        """Return q, q′, q″, q‴ at parameters (k,), shapes (k, n).

        `pieces` picks the side at a knot, where q‴ jumps.
        """
        where = self.pieces(u) if pieces is None else pieces
        s = (u - self.knots[where])[:, None]
        rest = self.coefficients[:, where]
        found = []
        for _ in range(4):
            value = rest[0]
            for coefficient in rest[1:]:
                value = value * s + coefficient
            found.append(value)
            rest = rest[:-1] * np.arange(len(rest) - 1.0, 0.0, -1.0)[:, None, None]
        return found[0], found[1], found[2], found[3]


def spline_path(positions: Array, velocity: Array) -> SplinePath:
    """Return the path through the points (n, joints), rad; velocity limits (joints,), rad/s.

    Raises ValueError if no two points differ.
    """
    points = merged(positions)
    if len(points) < 2:
        raise ValueError('a path needs two points that differ')
    chords = np.linalg.norm(np.diff(points, axis=0) / velocity, axis=1)
    knots = np.concatenate([[0.0], np.cumsum(chords)])
    return SplinePath(knots, np.asarray(CubicSpline(knots, points, bc_type='natural').c))
