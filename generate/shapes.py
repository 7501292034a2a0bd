# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The solids that links are made of: drums, rounded boxes and the castings around them. In mm."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from manifold3d import CrossSection, Manifold

Solid: TypeAlias = Manifold

DRUM_SIDES = 28
"""How many sides a drum has."""

_TURNS = {'x': (0.0, 90.0, 0.0), 'y': (-90.0, 0.0, 0.0), 'z': (0.0, 0.0, 0.0)}


def drum(
    axis: str,
    centre: Sequence[float],
    radius: float,
    span: tuple[float, float],
    edge: float = 3.0,
    sides: int = DRUM_SIDES,
    ends: str = 'both',
) -> Solid:
    """Return a cylinder along an axis with rounded edges.

    centre: x, y, z of its axis; the coordinate along `axis` does not count. span: from where to
    where it goes along its axis. edge: the radius of its edges. ends: which of them is to be seen
    and so has a rounded edge: 'low', 'high', 'both' or 'none'.
    """
    low, high = span
    edge = min(edge, (high - low) / 2.0, radius)
    angles = np.linspace(0.0, np.pi / 2.0, 4 if edge > 4.0 else 3 if edge > 2.0 else 2)
    corner = [(radius - edge * (1 - np.sin(a)), edge * (1 - np.cos(a))) for a in angles]
    bottom = corner if ends in ('low', 'both') else [(radius, 0.0)]
    top = corner if ends in ('high', 'both') else [(radius, 0.0)]
    profile = [(0.0, low), *((r, low + d) for r, d in bottom)]
    profile += [*((r, high - d) for r, d in reversed(top)), (0.0, high)]
    solid = CrossSection([profile]).revolve(sides).rotate(_TURNS[axis])
    place = np.array(centre, dtype=float)
    place['xyz'.index(axis)] = 0.0
    return solid.translate(place)


def box(
    x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], edge: float = 6.0
) -> Solid:
    """Return a box with rounded edges and corners."""
    ball = Manifold.sphere(edge, 12)
    places = [
        (u, v, w)
        for u in (x[0] + edge, x[1] - edge)
        for v in (y[0] + edge, y[1] - edge)
        for w in (z[0] + edge, z[1] - edge)
    ]
    return Manifold.batch_hull([ball.translate(place) for place in places])


def ball(centre: Sequence[float], radius: float) -> Solid:
    """Return a sphere."""
    return Manifold.sphere(radius, 20).translate(centre)


def casting(*solids: Solid) -> Solid:
    """Return the convex hull of solids, like a skin drawn over them."""
    return Manifold.batch_hull(list(solids))


def bolts(
    axis: str,
    centre: Sequence[float],
    circle: float,
    count: int,
    radius: float,
    span: tuple[float, float],
) -> list[Solid]:
    """Return bolt heads (or the holes for them) on a circle about an axis.

    circle: the radius on which they sit. span: from where to where they go along the axis.
    """
    first, second = ('xyz'.index(each) for each in 'xyz' if each != axis)
    heads = []
    for angle in 2.0 * np.pi * (np.arange(count) + 0.5) / count:
        place = list(centre)
        place[first] += circle * np.cos(angle)
        place[second] += circle * np.sin(angle)
        heads.append(drum(axis, place, radius, span, sides=6, ends='none'))
    return heads


def mirrored(solid: Solid) -> Solid:
    """Return the solid's mirror image at the plane y = 0."""
    return solid.mirror((0.0, 1.0, 0.0))
