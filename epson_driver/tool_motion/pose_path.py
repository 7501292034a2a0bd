# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Paths of the tool: lines and arcs, with blended corners.

The position moves evenly along a line or arc. The orientation turns evenly about a fixed axis, by
the shorter turn (slerp). Poses are homogeneous matrices, shape (4, 4), m.

A blend cuts the corner between two segments. It starts and ends at the distance of its radius from
the corner, measured along the path. Position and orientation have two continuous derivatives, so
the tool can keep its speed. Without a blend, the tool rests at the corner.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array
from epson_driver.motion.interpolation import hermite, polynomial
from epson_driver.tool_motion.tool_pose import homogeneous, rotation

MIN_BEND_M = 1e-5
"""Minimum distance of an arc's middle point from the line between its ends."""

HALF_TURN_MARGIN_RAD = 1e-6
"""Difference from π below which a turn counts as a half turn. The axis of a half turn is chosen so
that its largest component is positive."""


SHORTEST_PATH = 1e-6
"""Minimum length, m, or angle, rad, of a path."""


@dataclass(frozen=True, eq=False)
class PosePath:
    """A path of poses, with its length, m, and total turn, rad.

    pose: function from a fraction of the path, [0, 1], to the pose. derivatives: function from the
    fraction to the first three derivatives with respect to it, shape (3, 6). They are the
    derivatives of the position, m, and of the turn about the moving axes, rad.
    """

    length: float
    angle: float
    pose: Callable[[float], Array]
    derivatives: Callable[[float], Array]


def line(start: Array, end: Array) -> PosePath:
    """Return the straight path between two poses."""
    turn = _turn(start[:3, :3], end[:3, :3])
    offset = end[:3, 3] - start[:3, 3]
    derivatives = np.zeros((3, 6))
    derivatives[0] = *offset, *turn

    def pose(fraction: float) -> Array:
        return homogeneous(
            start[:3, :3] @ rotation(fraction * turn), start[:3, 3] + fraction * offset
        )

    def derivatives_at(_fraction: float) -> Array:
        return derivatives

    return PosePath(
        float(np.linalg.norm(offset)), float(np.linalg.norm(turn)), pose, derivatives_at
    )


def arc(start: Array, via: Array, end: Array) -> PosePath:
    """Return the arc from a pose through the point `via`, shape (3,), m, to another pose.

    Raises ValueError if the points do not define an arc.
    """
    a, b, c = start[:3, 3], np.asarray(via, dtype=float), end[:3, 3]
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    chord = float(np.linalg.norm(ac))
    if chord < MIN_BEND_M or np.linalg.norm(normal) < MIN_BEND_M * chord:
        raise ValueError(
            f'no arc from {_text(a)} over {_text(b)} to {_text(c)} m: the three points must '
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

    def pose(fraction: float) -> Array:
        point = center + size * (np.cos(fraction * sweep) * x + np.sin(fraction * sweep) * y)
        return homogeneous(start[:3, :3] @ rotation(fraction * turn), point)

    def derivatives(fraction: float) -> Array:
        out = size * (np.cos(fraction * sweep) * x + np.sin(fraction * sweep) * y)
        along = size * (np.cos(fraction * sweep) * y - np.sin(fraction * sweep) * x)
        result = np.zeros((3, 6))
        result[:, :3] = sweep * along, -(sweep**2) * out, -(sweep**3) * along
        result[0, 3:] = turn
        return result

    return PosePath(size * sweep, float(np.linalg.norm(turn)), pose, derivatives)


def level_arc(start: Array, via: Array, end: Array) -> PosePath:
    """Return a path whose projection to the xy plane is an arc, and whose z changes evenly."""
    rise = float(end[2, 3] - start[2, 3])
    level = end.copy()
    level[2, 3] = start[2, 3]
    path = arc(start, np.array([*via[:2], start[2, 3]]), level)

    def pose(fraction: float) -> Array:
        result = path.pose(fraction)
        result[2, 3] += fraction * rise
        return result

    def derivatives(fraction: float) -> Array:
        result = path.derivatives(fraction)
        result[0, 2] += rise
        return result

    return PosePath(float(np.hypot(path.length, rise)), path.angle, pose, derivatives)


def distance_from(point: Array, positions: Array) -> float:
    """Return the distance of a point, (3,), from a polygon through positions, (k, 3), m."""
    starts, steps = positions[:-1], np.diff(positions, axis=0)
    squares = np.maximum(np.sum(steps * steps, axis=1), 1e-30)
    fractions = np.clip(np.sum((point - starts) * steps, axis=1) / squares, 0.0, 1.0)
    nearest = starts + fractions[:, None] * steps
    return float(np.min(np.linalg.norm(point - nearest, axis=1)))


def _turn(first: Array, last: Array) -> Array:
    """Return the rotation vector from one rotation matrix to another, in the frame of `first`."""
    turn = first.T @ last
    twist = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine = float(np.linalg.norm(twist)) / 2.0
    angle = float(np.arctan2(sine, (np.trace(turn) - 1.0) / 2.0))
    if angle > np.pi - HALF_TURN_MARGIN_RAD:
        about = (turn + turn.T) / 2.0 + np.eye(3)
        axis = about[:, int(np.argmax(np.diag(about)))]
        return np.asarray(axis * (np.pi / np.linalg.norm(axis)))
    return np.asarray(twist * (angle / (2.0 * sine))) if sine > 0.0 else np.zeros(3)


def _text(point: Array) -> str:
    return '(' + ', '.join(f'{value:.4g}' for value in point) + ')'


class BlendError(ValueError):
    """A segment of a path is too short, or cannot be blended. `index`: index of the segment."""

    def __init__(self, index: int, text: str) -> None:
        super().__init__(text)
        self.index = index


@dataclass(frozen=True, eq=False)
class Run:
    """A path from rest to rest. Its parts are segments without their blends, and blends.

    segments: for each part, the index of its segment or, for a blend, of its two segments.
    """

    parts: tuple[PosePath, ...]
    segments: tuple[tuple[int, ...], ...]

    @property
    def last(self) -> int:
        return self.segments[-1][-1]

    @cached_property
    def seams(self) -> Array:
        """Distances at which the k parts start, and the last part ends, shape (k + 1,), m.

        For a part without length, the angle counts as length, rad.
        """
        return np.concatenate([[0.0], np.cumsum([size_of(part) for part in self.parts])])

    @cached_property
    def ends(self) -> Array:
        """Distances at which the segments end: the middles of the blends, and the end, m (rad)."""
        blends = [len(segment) > 1 for segment in self.segments]
        return np.append((self.seams[:-1] + self.seams[1:])[blends] / 2.0, self.seams[-1])

    def pose(self, distance: float) -> Array:
        index = int(np.searchsorted(self.seams, distance, 'right')) - 1
        index = min(max(index, 0), len(self.parts) - 1)
        fraction = (distance - self.seams[index]) / (self.seams[index + 1] - self.seams[index])
        return self.parts[index].pose(min(max(float(fraction), 0.0), 1.0))


def size_of(path: PosePath) -> float:
    """Return a path's length, m, or its angle, rad, if it has no length."""
    return path.length if path.length >= SHORTEST_PATH else path.angle


def runs(segments: Sequence[PosePath], blends: Sequence[float]) -> list[Run]:
    """Return the runs of a path, which are separated by rests.

    segments: each segment starts at the end of the previous one. blends: blend radius at the end
    of each segment except the last, m, or 0 for a rest. Raises BlendError if a segment has neither
    length nor turn, or is shorter than its blends.
    """
    radii = [0.0, *blends, 0.0]
    for index, (segment, (start, end)) in enumerate(zip(segments, pairwise(radii), strict=True)):
        if max(segment.length, segment.angle) < SHORTEST_PATH:
            raise BlendError(index, 'the tool is already at the target')
        if start + end > segment.length:
            words = ' and '.join(f'{radius:g} m' for radius in (start, end) if radius > 0.0)
            raise BlendError(
                index,
                f'the motion is {segment.length:.4g} m long, shorter than the blend of {words}',
            )
    result: list[Run] = []
    parts: list[PosePath] = []
    owners: list[tuple[int, ...]] = []
    for index, segment in enumerate(segments):
        first, last = radii[index], segment.length - radii[index + 1]
        if last - first >= SHORTEST_PATH or segment.length < SHORTEST_PATH:
            scale = segment.length if segment.length >= SHORTEST_PATH else 1.0
            end = last / scale if segment.length >= SHORTEST_PATH else 1.0
            parts.append(_part(segment, first / scale, end))
            owners.append((index,))
        if radii[index + 1] > 0.0:
            parts.append(_corner(segment, segments[index + 1], radii[index + 1]))
            owners.append((index, index + 1))
        else:
            result.append(Run(tuple(parts), tuple(owners)))
            parts, owners = [], []
    return result


def _part(path: PosePath, first: float, last: float) -> PosePath:
    fraction = last - first
    scale = fraction ** np.arange(1, 4)[:, None]
    return PosePath(
        fraction * path.length,
        fraction * path.angle,
        lambda of_part: path.pose(first + fraction * of_part),
        lambda of_part: scale * path.derivatives(first + fraction * of_part),
    )


def _corner(before: PosePath, after: PosePath, radius: float) -> PosePath:
    """Return a smooth curve that replaces the corner between two segments.

    It starts `radius` m before the corner and ends `radius` m after it. Its length counts as twice
    the radius, slightly more than the real length. The position, and the rotation vector from the
    orientation at the corner, are polynomials.
    """
    entry, exit_ = 1.0 - radius / before.length, radius / after.length
    corner = before.pose(1.0)
    ends = []
    for path, fraction, turned in ((before, entry, entry - 1.0), (after, exit_, exit_)):
        by_fraction = path.derivatives(fraction)
        by_part = by_fraction * (2.0 * radius / path.length) ** np.arange(1, 4)[:, None]
        offset = np.concatenate(
            [path.pose(fraction)[:3, 3] - corner[:3, 3], turned * by_fraction[0, 3:]]
        )
        ends.append((offset, by_part[0], by_part[1]))
    coefficients = hermite(*ends)
    angle = float(np.linalg.norm(ends[0][0][3:]) + np.linalg.norm(ends[1][0][3:]))

    def pose(fraction: float) -> Array:
        (change,) = polynomial(coefficients, np.array([fraction]))
        return homogeneous(corner[:3, :3] @ rotation(change[3:]), corner[:3, 3] + change[:3])

    def derivatives(fraction: float) -> Array:
        fractions = np.array([fraction])
        return np.concatenate([polynomial(coefficients, fractions, order) for order in (1, 2, 3)])

    return PosePath(2.0 * radius, angle, pose, derivatives)
