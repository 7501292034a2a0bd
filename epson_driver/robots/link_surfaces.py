# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The surfaces of an arm: the boxes and cylinders of its URDF as triangles, per link."""

from collections.abc import Iterator
from itertools import pairwise, product
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from epson_driver.motion import Array
from epson_driver.robots.chain import Frame
from epson_driver.robots.model import RobotModel
from epson_driver.robots.urdf import urdf

SIDES = 24
"""Number of sides of a cylinder's approximation."""

EDGE_M = 0.004
"""Maximum width of bevelled edges, m. They make edges visible in the light."""

EDGE_SHARE = 0.12
"""Maximum width of bevelled edges as a share of the smallest size."""


class Surface(NamedTuple):
    """Triangles in the frame of a link, and their colour: red, green, blue, 0 … 1.

    corners: shape (n, 3, 3), m, counter-clockwise seen from outside.
    """

    corners: npt.NDArray[np.float32]
    colour: tuple[float, float, float]


def link_surfaces(model: RobotModel) -> list[list[Surface]]:
    """Return the surfaces of base_link, link_1 …, one for each colour."""
    root = ElementTree.fromstring(urdf(model.file))  # noqa: S314 - made by us
    links = {link.get('name'): link for link in root.iter('link')}
    numbers = range(1, len(model.joint_names) + 1)
    names = ['base_link_inertia', *(f'link_{number}' for number in numbers)]
    return [_by_colour(links[name]) for name in names]


def _by_colour(link: ElementTree.Element) -> list[Surface]:
    found: dict[tuple[float, float, float], list[Array]] = {}
    for visual in link.iter('visual'):
        red, green, blue, _ = _numbers(visual.find('material/color'), 'rgba')
        found.setdefault((red, green, blue), []).extend(_solids(visual))
    return [
        Surface(np.concatenate(corners).astype(np.float32), colour)
        for colour, corners in found.items()
    ]


def _solids(visual: ElementTree.Element) -> Iterator[Array]:
    origin = visual.find('origin')
    frame = Frame(np.array(_numbers(origin, 'xyz')), np.array(_numbers(origin, 'rpy'))).matrix
    for solid in visual.iterfind('geometry/*'):
        if solid.tag == 'box':
            corners = box(*_numbers(solid, 'size'))
        else:
            corners = cylinder(*_numbers(solid, 'radius'), *_numbers(solid, 'length'))
        yield corners @ frame[:3, :3].T + frame[:3, 3]


def box(x: float, y: float, z: float) -> Array:
    """Return the triangles of a box with bevelled edges about its centre, shape (n, 3, 3), m."""
    half = np.array([x, y, z]) / 2.0
    bevel = _bevel(2.0 * float(half.min()))
    # at each corner a point on each of the three faces
    at = {
        (signs, axis): np.array(signs) * (half - bevel * (np.arange(3) != axis))
        for signs in product((-1, 1), repeat=3)
        for axis in range(3)
    }
    polygons = [[at[signs, axis] for axis in range(3)] for signs in product((-1, 1), repeat=3)]
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        for side, other in product((-1, 1), repeat=2):
            low, high = np.zeros((2, 3), dtype=int)
            low[[axis, one, two]], high[[axis, one, two]] = (-1, side, other), (1, side, other)
            a, b = tuple(low.tolist()), tuple(high.tolist())
            polygons.append([at[a, one], at[b, one], at[b, two], at[a, two]])
        for side in (-1, 1):
            ring = []
            for around in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                signs = np.zeros(3, dtype=int)
                signs[[axis, one, two]] = (side, *around)
                ring.append(at[tuple(signs.tolist()), axis])
            polygons.append(ring)
    return _fans(polygons)


def cylinder(radius: float, length: float) -> Array:
    """Return the triangles of a cylinder about z with bevelled edges, shape (n, 3, 3), m."""
    bevel = _bevel(min(radius, length))
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(SIDES)], axis=1)
    half = np.array([0.0, 0.0, length / 2.0])
    inner, lower = (radius - bevel) * circle, half - [0.0, 0.0, bevel]
    rings = [inner - half, radius * circle - lower, radius * circle + lower, inner + half]
    polygons = [list(rings[0]), list(rings[-1])]
    for below, above in pairwise(rings):
        for i in range(SIDES):
            j = (i + 1) % SIDES
            polygons.append([below[i], below[j], above[j], above[i]])
    return _fans(polygons)


def _bevel(smallest: float) -> float:
    return min(EDGE_M, EDGE_SHARE * smallest)


def _fans(polygons: list[list[Array]]) -> Array:
    """Return the triangles of a convex solid about 0 from its faces, all turned outwards."""
    corners = np.array(
        [(ring[0], ring[i], ring[i + 1]) for ring in polygons for i in range(1, len(ring) - 1)]
    )
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum('ij,ij->i', normals, corners[:, 0]) < 0.0
    corners[inwards] = corners[inwards][:, ::-1]
    return corners


def _numbers(element: ElementTree.Element | None, key: str) -> list[float]:
    return [] if element is None else [float(word) for word in element.get(key, '').split()]
