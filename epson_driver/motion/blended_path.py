# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Paths of several lines and arcs, with the corners between them blended or not.

A blend leaves one segment, and reaches the next, at its radius from the corner, as measured along
the path: the corner is cut. Place and turn go over with two continuous derivatives, so that the
tool need not slow down for the seam. Without a blend the tool rests at the corner.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from epson_driver.motion.cartesian import PosePath, homogeneous, rotation
from epson_driver.motion.interpolation import hermite
from epson_driver.motion.limits import Array

SHORTEST_WAY = 1e-6
"""m or rad; a path with less of both is no motion."""

_ORDERS = np.arange(4)[:, None]
_POWERS = np.arange(6)
_FACTORS = np.array(
    [np.ones(6), _POWERS, _POWERS * (_POWERS - 1), _POWERS * (_POWERS - 1) * (_POWERS - 2)]
)
"""Of a polynomial's terms, by the order of the derivative."""


class BlendError(ValueError):
    """A path whose blends do not fit; `index`: of the segment where, from 0."""

    def __init__(self, index: int, text: str) -> None:
        super().__init__(text)
        self.index = index


@dataclass(frozen=True, eq=False)
class Run:
    """Parts of a path that follow each other smoothly: the tool rests at both ends only.

    segments: of each part the index of its segment, or of both where it is a blend.
    """

    parts: tuple[PosePath, ...]
    segments: tuple[tuple[int, ...], ...]

    @property
    def last(self) -> int:
        """The index of the segment that the run ends with."""
        return self.segments[-1][-1]

    @cached_property
    def seams(self) -> Array:
        """Where the parts begin, and the end, shape (k + 1,): m, rad if the tool only turns."""
        return np.concatenate([[0.0], np.cumsum([size_of(part) for part in self.parts])])

    @cached_property
    def ends(self) -> Array:
        """Where each segment ends, m (rad): in the middle of its blend, the last with the run."""
        blends = [len(each) > 1 for each in self.segments]
        return np.append((self.seams[:-1] + self.seams[1:])[blends] / 2.0, self.seams[-1])

    def pose(self, way: float) -> Array:
        """Return the pose after a way, m (rad), from 0 to the last seam."""
        index = int(np.searchsorted(self.seams, way, 'right')) - 1
        index = min(max(index, 0), len(self.parts) - 1)
        share = (way - self.seams[index]) / (self.seams[index + 1] - self.seams[index])
        return self.parts[index].pose(min(max(float(share), 0.0), 1.0))


def size_of(path: PosePath) -> float:
    """Return a path's length, m, or its angle, rad, if it has no length."""
    return path.length if path.length >= SHORTEST_WAY else path.angle


def runs(segments: Sequence[PosePath], blends: Sequence[float]) -> list[Run]:
    """Return a path's runs. blends: the radius, m, at the end of each segment but the last.

    A segment begins with the pose that the one before ends with. Raises BlendError for segments
    without way and turn, and for blends that are longer than their segments.
    """
    radii = [0.0, *blends, 0.0]
    for index, (segment, (begin, end)) in enumerate(zip(segments, pairwise(radii), strict=True)):
        if max(segment.length, segment.angle) < SHORTEST_WAY:
            raise BlendError(index, 'the tool is there already')
        if begin + end > segment.length:
            words = ' and '.join(f'{radius:g} m' for radius in (begin, end) if radius > 0.0)
            raise BlendError(
                index, f'the way there is {segment.length:.4g} m: a blend of {words} is longer'
            )
    found: list[Run] = []
    parts: list[PosePath] = []
    owners: list[tuple[int, ...]] = []
    for index, segment in enumerate(segments):
        first, last = radii[index], segment.length - radii[index + 1]
        if last - first >= SHORTEST_WAY or segment.length < SHORTEST_WAY:
            scale = segment.length if segment.length >= SHORTEST_WAY else 1.0
            end = last / scale if segment.length >= SHORTEST_WAY else 1.0
            parts.append(_part(segment, first / scale, end))
            owners.append((index,))
        if radii[index + 1] > 0.0:
            parts.append(_corner(segment, segments[index + 1], radii[index + 1]))
            owners.append((index, index + 1))
        else:
            found.append(Run(tuple(parts), tuple(owners)))
            parts, owners = [], []
    return found


def _part(path: PosePath, first: float, last: float) -> PosePath:
    """Return the part of a path between two shares."""
    share = last - first
    scale = share ** np.arange(1, 4)[:, None]
    return PosePath(
        share * path.length,
        share * path.angle,
        lambda of_part: path.pose(first + share * of_part),
        lambda of_part: scale * path.derivatives(first + share * of_part),
    )


def _corner(before: PosePath, after: PosePath, radius: float) -> PosePath:
    """Return a path that leaves one `radius` m before its end and reaches the next that far on.

    Its length is twice the radius: a bit more than the way, as it cuts the corner. Place and turn
    are polynomials, the turn as a rotation vector in the corner's frame.
    """
    leave, reach = 1.0 - radius / before.length, radius / after.length
    corner = before.pose(1.0)
    ends = []
    for path, share, turned in ((before, leave, leave - 1.0), (after, reach, reach)):
        by_share = path.derivatives(share)
        by_part = by_share * (2.0 * radius / path.length) ** np.arange(1, 4)[:, None]
        away = np.concatenate([path.pose(share)[:3, 3] - corner[:3, 3], turned * by_share[0, 3:]])
        ends.append((away, by_part[0], by_part[1]))
    coefficients = hermite(*ends)
    angle = float(np.linalg.norm(ends[0][0][3:]) + np.linalg.norm(ends[1][0][3:]))

    def pose(share: float) -> Array:
        at = share**_POWERS @ coefficients
        return homogeneous(corner[:3, :3] @ rotation(at[3:]), corner[:3, 3] + at[:3])

    def derivatives(share: float) -> Array:
        terms = _FACTORS * share ** np.maximum(_POWERS - _ORDERS, 0)
        return np.asarray((terms @ coefficients)[1:])

    return PosePath(2.0 * radius, angle, pose, derivatives)
