# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm as the page draws it: its joints, and the surfaces of its links in few bytes."""

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from epson_driver.inputs import read_file
from epson_driver.motion import Array
from epson_driver.robots import RobotModel
from epson_driver.share import share_folder

PACKAGE_URI = 'package://epson_driver/'
MAX_MESH_BYTES = 5_000_000

_FACET = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])
_STL_HEADER = 84


def arm_shape(model: RobotModel) -> dict[str, Any]:
    """Return what the page needs to draw the arm at any joint positions.

    A model without a URDF of its own is drawn as cylinders from joint to joint, by the page.
    """
    links = {f'link_{number}': number for number in range(1, len(model.joint_names) + 1)}
    meshes = []
    file = share_folder('urdf', f'{model.name}.urdf')
    if file.is_file():
        for link, mesh, colour in _visuals(file):
            number = 0 if link == 'base_link' else links.get(link)
            if number is not None:
                meshes.append({'link': number, 'colour': colour} | packed(*_corners(mesh)))
    return {
        'origins': model.chain.origins.tolist(),
        'axes': model.chain.axes.tolist(),
        'types': list(model.joint_types),
        'tool0': model.tool0.xyz.tolist(),
        'meshes': meshes,
    }


def _visuals(file: Path) -> Iterator[tuple[str, Path, list[float]]]:
    """Yield link, mesh file and colour of each visual of a URDF of this package."""
    root = ElementTree.parse(file).getroot()  # noqa: S314 - our own file
    for link in root.iter('link'):
        for visual in link.iter('visual'):
            mesh = visual.find('geometry/mesh')
            colour = visual.find('material/color')
            if mesh is None:
                continue
            name = mesh.get('filename', '').removeprefix(PACKAGE_URI)
            rgba = '0.6 0.6 0.6' if colour is None else colour.get('rgba', '0.6 0.6 0.6')
            yield link.get('name', ''), share_folder(name), [float(v) for v in rgba.split()[:3]]


def _corners(path: Path) -> tuple[Array, Any]:
    """Return the vertices, shape (v, 3), m, and triangles, shape (f, 3), of a binary STL file."""
    facets = np.frombuffer(read_file(path, MAX_MESH_BYTES), _FACET, offset=_STL_HEADER)
    corners = facets['corners'].reshape(-1, 3)
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    return vertices.astype(float), index.reshape(-1, 3)


def packed(vertices: Array, triangles: Any) -> dict[str, Any]:
    """Return a mesh as base64: vertices as 16 bit numbers within its box, 16 bit indices."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    size = np.where(high > low, high - low, 1.0)
    steps = np.round((vertices - low) / size * 65535.0).astype('<u2')
    if len(vertices) > 65535:
        raise ValueError(f'{len(vertices)} vertices: at most 65535 can be numbered')
    return {
        'low': low.tolist(),
        'size': size.tolist(),
        'vertices': text(steps),
        'triangles': text(triangles.astype('<u2')),
    }


def text(values: Any) -> str:
    """Return an array's bytes as base64."""
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode('ascii')
