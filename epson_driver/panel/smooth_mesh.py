# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The meshes of an arm for a viewer that averages normals: smooth, but for their creases."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from epson_driver.motion import Array
from epson_driver.robots import RobotModel
from epson_driver.robots.link_surfaces import Surface, link_surfaces

CREASE_RAD = np.radians(35.0)
"""Facets that meet at less than this are shown as one smooth surface."""


class Mesh(NamedTuple):
    """Vertices, shape (v, 3), m, faces of their indices, shape (f, 3), and colour, 0 … 255."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    colour: tuple[int, int, int]


def arm_meshes(model: RobotModel) -> list[list[Mesh]]:
    """Return the meshes of base_link, link_1 … in their own frames."""
    return [[_smooth_mesh(surface) for surface in link] for link in link_surfaces(model)]


def _smooth_mesh(surface: Surface) -> Mesh:
    red, green, blue = (round(255.0 * share) for share in surface.colour)
    return Mesh(*_smoothed(surface.corners), (red, green, blue))


def _smoothed(corners: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return vertices and faces in which neighbours share a vertex unless a crease parts them.

    A viewer averages normals over the faces of a vertex: so the creases stay sharp.
    """
    count = len(corners)
    flat = np.ascontiguousarray(corners.reshape(-1, 3).round(6))
    _, places = np.unique(flat, axis=0, return_inverse=True)
    places = places.reshape(count, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    # every edge twice, as (smaller place, larger place): once for each of its two faces
    face = np.repeat(np.arange(count), 3)
    begin = np.tile(np.arange(3), count)
    first, second = places[face, begin], places[face, (begin + 1) % 3]
    corner_at_first, corner_at_second = face * 3 + begin, face * 3 + (begin + 1) % 3
    turned = first > second
    low, high = np.where(turned, second, first), np.where(turned, first, second)
    at_low = np.where(turned, corner_at_second, corner_at_first)
    at_high = np.where(turned, corner_at_first, corner_at_second)
    order = np.lexsort((high, low))
    pair = (low[order][1:] == low[order][:-1]) & (high[order][1:] == high[order][:-1])
    one, other = order[:-1][pair], order[1:][pair]
    smooth = np.einsum('ij,ij->i', normals[face[one]], normals[face[other]]) > np.cos(CREASE_RAD)
    one, other = one[smooth], other[smooth]
    joined = np.concatenate(
        [
            np.stack([at_low[one], at_low[other]], axis=1),
            np.stack([at_high[one], at_high[other]], axis=1),
        ]
    )
    labels = _groups(3 * count, joined)
    kept, faces = np.unique(labels, return_inverse=True)
    return flat[kept], faces.reshape(count, 3).astype(np.uint32)


def _groups(count: int, joined: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return for each of `count` things the smallest that it is joined with, be it by others."""
    labels = np.arange(count)
    while True:
        before = labels.copy()
        smaller = labels[joined].min(axis=1)
        np.minimum.at(labels, joined[:, 0], smaller)
        np.minimum.at(labels, joined[:, 1], smaller)
        if np.array_equal(labels, before):
            return labels


def quaternion(axis: Array, angle: float) -> tuple[float, float, float, float]:
    """Return w, x, y, z of the rotation by an angle, rad, about a unit axis."""
    x, y, z = np.sin(angle / 2.0) * axis
    return float(np.cos(angle / 2.0)), float(x), float(y), float(z)
