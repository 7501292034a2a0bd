# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A robot's links as bodies, from its URDF file, for pinocchio and coal."""

from pathlib import Path
from typing import Any, NamedTuple

import coal
import pinocchio

from epson_driver.robots.link_meshes import PACKAGE_URI


class Links(NamedTuple):
    """pinocchio's kinematic model, its geometry model, and the URDF that they were made of."""

    model: Any
    bodies: Any
    urdf: str


def convex_links(urdf: Path) -> Links:
    """Return the collision geometry of a file urdf/NAME.urdf; meshes count as their hulls.

    Meshes of this package are taken from the folder that has urdf/, installed or not.
    """
    links = _links(urdf, pinocchio.GeometryType.COLLISION)
    for body in links.bodies.geometryObjects:
        if isinstance(body.geometry, coal.BVHModelBase):
            body.geometry.buildConvexHull(True, 'Qt')
            body.geometry = body.geometry.convex
    return links


def visual_links(urdf: Path) -> Links:
    """Return the visual geometry, as meshes."""
    return _links(urdf, pinocchio.GeometryType.VISUAL)


def _links(urdf: Path, kind: Any) -> Links:
    text = urdf.read_text(encoding='utf-8').replace(PACKAGE_URI, f'{urdf.parents[1]}/')
    model = pinocchio.buildModelFromXML(text)
    return Links(model, pinocchio.buildGeomFromUrdfString(model, text, kind), text)
