# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Straight lines and arcs of a frame, as poses over a path parameter from 0 to 1.

The place runs evenly along the line or arc; the orientation turns evenly about one fixed axis, the
shorter way (slerp). Poses are homogeneous matrices, shape (4, 4), m. blended_path.py makes paths
of several of them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from epson_driver.motion.limits import Array

MIN_BEND_M = 1e-5
"""An arc whose middle point is closer than this to the line between its ends is none."""

HALF_TURN_MARGIN_RAD = 1e-6
"""A turn that is this close to π could go either way."""


@dataclass(frozen=True, eq=False)
class PosePath:
    """Poses from `pose(0)` to `pose(1)`. length: m, of the way; angle: rad, of the turn.

    derivatives: the first three by the share, shape (3, 6), at a share: of the place, m, and of
    the turn about the axes of the frame itself, rad.
    """

    length: float
    angle: float
    pose: Callable[[float], Array]
    derivatives: Callable[[float], Array]


def line(start: Array, end: Array) -> PosePath:
    """Return the straight way between two poses. Raises ValueError for a turn by π."""
    turn = _turn(start[:3, :3], end[:3, :3])
    way = end[:3, 3] - start[:3, 3]
    derivatives = np.zeros((3, 6))
    derivatives[0] = *way, *turn

    def pose(share: float) -> Array:
        return homogeneous(start[:3, :3] @ rotation(share * turn), start[:3, 3] + share * way)

    def derivatives_at(_share: float) -> Array:
        return derivatives

    return PosePath(float(np.linalg.norm(way)), float(np.linalg.norm(turn)), pose, derivatives_at)


def arc(start: Array, via: Array, end: Array) -> PosePath:
    """Return the part of a circle from a pose through a point, shape (3,), m, to another pose.

    Raises ValueError for points that make no arc, and for a turn by π.
    """
    a, b, c = start[:3, 3], np.asarray(via, dtype=float), end[:3, 3]
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    chord = float(np.linalg.norm(ac))
    if chord < MIN_BEND_M or np.linalg.norm(normal) < MIN_BEND_M * chord:
        raise ValueError(
            f'no arc leads from {_text(a)} over {_text(b)} to {_text(c)} m: the three points must '
            f'not be in one line, and the first and the last must differ'
        )
    square = float(normal @ normal)
    center = a + np.cross((ab @ ab) * ac - (ac @ ac) * ab, normal) / (2.0 * square)
    radius = a - center
    x = radius / np.linalg.norm(radius)
    y = np.cross(normal / np.sqrt(square), x)
    sweep = float(np.arctan2((c - center) @ y, (c - center) @ x)) % (2.0 * np.pi)
    turn = _turn(start[:3, :3], end[:3, :3])
    size = float(np.linalg.norm(radius))

    def pose(share: float) -> Array:
        at = center + size * (np.cos(share * sweep) * x + np.sin(share * sweep) * y)
        return homogeneous(start[:3, :3] @ rotation(share * turn), at)

    def derivatives(share: float) -> Array:
        out = size * (np.cos(share * sweep) * x + np.sin(share * sweep) * y)
        along = size * (np.cos(share * sweep) * y - np.sin(share * sweep) * x)
        result = np.zeros((3, 6))
        result[:, :3] = sweep * along, -(sweep**2) * out, -(sweep**3) * along
        result[0, 3:] = turn
        return result

    return PosePath(size * sweep, float(np.linalg.norm(turn)), pose, derivatives)


def distance_from(point: Array, places: Array) -> float:
    """Return how far a point, shape (3,), is from the polygon through places, shape (k, 3), m."""
    begins, steps = places[:-1], np.diff(places, axis=0)
    squares = np.maximum(np.sum(steps * steps, axis=1), 1e-30)
    shares = np.clip(np.sum((point - begins) * steps, axis=1) / squares, 0.0, 1.0)
    nearest = begins + shares[:, None] * steps
    return float(np.min(np.linalg.norm(point - nearest, axis=1)))


def rotation(turn: Array) -> Array:
    """Return the rotation by a rotation vector, rad, shape (3,): about it, by its length."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / angle if angle > 0.0 else turn
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    versed = 2.0 * np.sin(angle / 2.0) ** 2
    return np.asarray(np.eye(3) + np.sin(angle) * cross + versed * cross @ cross)


def homogeneous(turned: Array, place: Array) -> Array:
    """Return the pose of a rotation matrix, shape (3, 3), and a place, shape (3,), m."""
    pose = np.eye(4)
    pose[:3, :3] = turned
    pose[:3, 3] = place
    return pose


def _turn(first: Array, last: Array) -> Array:
    """Return the turn from one rotation matrix to another, in the first, as a rotation vector."""
    turn = first.T @ last
    twist = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine = float(np.linalg.norm(twist)) / 2.0
    angle = float(np.arctan2(sine, (np.trace(turn) - 1.0) / 2.0))
    if angle > np.pi - HALF_TURN_MARGIN_RAD:
        raise ValueError('the orientation turns by half a turn, either way: go in two steps')
    return np.asarray(twist * (angle / (2.0 * sine))) if sine > 0.0 else np.zeros(3)


def _text(point: Array) -> str:
    return '(' + ', '.join(f'{value:.4g}' for value in point) + ')'
