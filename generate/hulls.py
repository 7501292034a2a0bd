# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Convex solids with few faces around a solid, for collision checking."""

import itertools

import numpy as np
from manifold3d import Manifold

from epson_driver.motion import Array
from generate.shapes import Solid

MARGIN_MM = 0.1
"""How far outside the solid the faces lie: more than the rounding error."""

MAX_FACES = 18
"""Per solid; it has fewer than four times as many triangles."""

MAX_VOLUME_RATIO = 1.04
"""No further face is cut once the volume is at most this many times that of the convex hull."""

TRIALS_PER_CUT = 8
"""How many planes are tried for each cut: those below the farthest corners."""

_AXES = np.concatenate([np.eye(3), -np.eye(3)])
_SLANTS = np.array(
    [s for s in itertools.product((-1, 0, 1), repeat=3) if abs(sum(map(abs, s))) > 1]
)


def few_faces(solid: Solid, symmetric: bool = False) -> Solid:
    """Return a convex solid that encloses `solid` closely.

    A box is cut by planes that touch the hull; each time by one that takes away most, together
    with its mirror image at y = 0 if `solid` is symmetric.
    """
    hull = solid.hull()
    mesh = hull.to_mesh()
    points = np.asarray(mesh.vert_properties, dtype=float)[:, :3]
    candidates = np.concatenate([_slants(), _facets(points, np.asarray(mesh.tri_verts))])
    supports = np.max(candidates @ points.T, axis=1)
    low, high = points.min(axis=0) - MARGIN_MM, points.max(axis=0) + MARGIN_MM
    around = Manifold.cube(high - low).translate(low)
    faces = len(_AXES)
    while faces < MAX_FACES and around.volume() > MAX_VOLUME_RATIO * hull.volume():
        corners = np.asarray(around.to_mesh().vert_properties, dtype=float)[:, :3]
        overhang = np.round(np.max(candidates @ corners.T, axis=1) - supports, 3)
        cuts = []
        for normal in candidates[np.argsort(-overhang, kind='stable')[:TRIALS_PER_CUT]]:
            planes = [normal]
            if symmetric and abs(normal[1]) > 1e-3:
                planes.append(normal * (1.0, -1.0, 1.0))
            cut = around
            for plane in planes:
                cut = cut.trim_by_plane(-plane, -float(np.max(points @ plane)) - MARGIN_MM)
            gain = (around.volume() - cut.volume()) / len(planes)
            cuts.append((round(gain, 3), cut, len(planes)))
        _, around, more = max(cuts, key=lambda each: each[0])
        faces += more
    corners = np.asarray(around.to_mesh().vert_properties, dtype=float)[:, :3]
    return Manifold.hull_points(np.unique(np.round(corners, 1), axis=0))


def _slants() -> Array:
    return np.asarray(_SLANTS / np.linalg.norm(_SLANTS, axis=1)[:, None])


def _facets(points: Array, triangles: Array) -> Array:
    """Return the normals of a hull's larger facets, neighbours taken together."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    normals = normals[np.linalg.norm(normals, axis=1) > 1e-6]
    keys, which = np.unique(
        np.round(normals / np.linalg.norm(normals, axis=1)[:, None] * 6.0),
        axis=0,
        return_inverse=True,
    )
    sums = np.zeros((len(keys), 3))
    np.add.at(sums, which.ravel(), normals)
    areas = np.linalg.norm(sums, axis=1)
    large = np.argsort(-np.round(areas, 3), kind='stable')[:40]
    return np.asarray(sums[large] / areas[large, None])
