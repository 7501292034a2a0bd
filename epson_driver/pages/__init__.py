# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Shared parts of the report and the panel: the drawing of an arm, three.js and uPlot."""

import base64
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt

from epson_driver.motion import Array
from epson_driver.robots import RobotModel
from epson_driver.robots.urdf import link_surfaces


def packed_arm(model: RobotModel) -> dict[str, Any]:
    meshes = [
        {'link': number, 'colour': list(colour)} | packed(*_indexed(corners))
        for number, link in enumerate(link_surfaces(model))
        for corners, colour in link
    ]
    return {
        'origins': model.chain.origins.tolist(),
        'axes': model.chain.axes.tolist(),
        'types': list(model.joint_types),
        'tool0': model.tool0.xyz.tolist(),
        'meshes': meshes,
    }


def _indexed(corners: npt.NDArray[np.float32]) -> tuple[Array, Any]:
    """Return distinct vertices, shape (v, 3), m, and indices of the triangles, shape (f, 3)."""
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return vertices.astype(float), index.reshape(-1, 3)


def packed(vertices: Array, triangles: Any) -> dict[str, Any]:
    """Return a mesh as base64.

    The vertices are 16-bit fractions of the mesh's bounding box, and the indices have 16 bits.
    Raises ValueError if the mesh has more than 65535 vertices.
    """
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
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode('ascii')


def asset(name: str) -> str:
    return files(__name__).joinpath('assets', name).read_text(encoding='utf-8')
