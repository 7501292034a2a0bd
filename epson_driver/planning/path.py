# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Corners made round, as far as there is room, and points for the smoother.

A path is a list of pieces, each an array of shape (k, n) of dense points, rad; a piece begins
where the one before ends, and there is a corner. Where a joint is prismatic, its positions come
and go as rad, by the metric of workspace.py.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array

DENSE_SPACING_RAD = 0.01
"""Points of a piece are at most so far apart, rad (over all joints, Euclidean)."""

MAX_ROUNDED_SHARE = 0.45
"""A corner is rounded over this share of the pieces on both sides at most."""

MAX_ROUNDED_RAD = 0.6
"""And over so much of each, rad."""

MIN_ROUNDED_RAD = 0.03
"""A corner is left as it is if it cannot be rounded over so much, rad."""


def line(start: Array, goal: Array) -> Array:
    """Return the dense points of a straight line in joint space."""
    count = int(np.ceil(np.linalg.norm(goal - start) / DENSE_SPACING_RAD)) + 1
    return np.linspace(start, goal, max(count, 2))


def rounded(pieces: Sequence[Array], allowed: Callable[[Array], bool]) -> Array:
    """Return one path, shape (k, n), dense, with its corners rounded where that is `allowed`."""
    lengths = [_lengths(piece) for piece in pieces]
    parts = []
    begin = 0.0
    for index, (piece, way) in enumerate(zip(pieces, lengths, strict=True)):
        if index == len(pieces) - 1:
            parts.append(_between(piece, way, begin, way[-1]))
            break
        following, next_way = pieces[index + 1], lengths[index + 1]
        over = min(MAX_ROUNDED_SHARE * min(way[-1], next_way[-1]), MAX_ROUNDED_RAD)
        bend = None
        while over > MIN_ROUNDED_RAD and bend is None:
            bend = _bend(
                _at(piece, way, way[-1] - over), piece[-1], _at(following, next_way, over)
            )
            if not allowed(bend):
                bend, over = None, over / 1.5
        over = over if bend is not None else 0.0
        parts.append(_between(piece, way, begin, way[-1] - over))
        if bend is not None:
            parts.append(bend)
        begin = over
    points = np.concatenate(parts)
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9
    return np.asarray(points[np.concatenate([[True], apart])])


def thinned(path: Array, spacing: float) -> Array:
    """Return points of a path, `spacing` rad apart and evenly, with both its ends."""
    way = _lengths(path)
    count = max(int(np.ceil(way[-1] / spacing)), 2)
    return np.array([_at(path, way, s) for s in np.linspace(0.0, way[-1], count + 1)])


def dense(path: Array, metric: Array | float = 1.0) -> Array:
    """Return a path with its points no further apart than DENSE_SPACING_RAD.

    metric: rad per rad or m of each joint, shape (n,).
    """
    pieces = (line(start, goal)[1:] for start, goal in pairwise(path * metric))
    return np.concatenate([path[:1], *(piece / metric for piece in pieces)])


def _bend(start: Array, corner: Array, end: Array) -> Array:
    """Return a curve that leaves and joins two lines without a jump of direction or curvature.

    A Bézier curve of degree five whose first and last three control points are in a line.
    """
    control = (
        start,
        start + 0.4 * (corner - start),
        start + 0.8 * (corner - start),
        end + 0.8 * (corner - end),
        end + 0.4 * (corner - end),
        end,
    )
    length = np.linalg.norm(corner - start) + np.linalg.norm(end - corner)
    s = np.linspace(0.0, 1.0, int(np.ceil(1.5 * length / DENSE_SPACING_RAD)) + 2)[:, None]
    weights = (1, 5, 10, 10, 5, 1)
    return np.asarray(
        sum(
            weight * (1 - s) ** (5 - power) * s**power * point
            for power, (weight, point) in enumerate(zip(weights, control, strict=True))
        )
    )


def _lengths(path: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def _at(path: Array, way: Array, s: float) -> Array:
    return np.array([np.interp(s, way, column) for column in path.T])


def _between(path: Array, way: Array, begin: float, end: float) -> Array:
    inside = (way > begin) & (way < end)
    return np.concatenate([[_at(path, way, begin)], path[inside], [_at(path, way, end)]])
