# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The visual meshes of an arm, link by link, as its URDF in this package has them."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from epson_driver.inputs import read_file
from epson_driver.robots.model import RobotModel
from epson_driver.share import share_folder

PACKAGE_URI = 'package://epson_driver/'
MAX_MESH_BYTES = 5_000_000

NO_COLOUR = '0.6 0.6 0.6'

_FACET = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])
_STL_HEADER = 84


class LinkMesh(NamedTuple):
    """A binary STL file in the frame of its link, and its colour: red, green, blue, 0 … 1."""

    file: Path
    colour: tuple[float, float, float]

    def corners(self) -> npt.NDArray[np.float32]:
        """Return the corners of its triangles, shape (n, 3, 3), m. Raises OSError, InputError."""
        facets = np.frombuffer(read_file(self.file, MAX_MESH_BYTES), _FACET, offset=_STL_HEADER)
        return facets['corners'].astype(np.float32)


def link_meshes(model: RobotModel) -> list[list[LinkMesh]] | None:
    """Return the meshes of base_link, link_1 …; None for a model without a URDF in urdf/."""
    file = share_folder('urdf') / f'{model.name}.urdf'
    if not file.is_file():
        return None
    root = ElementTree.parse(file).getroot()  # noqa: S314 - our own file
    links = {link.get('name'): link for link in root.iter('link')}
    names = ['base_link', *(f'link_{number}' for number in range(1, len(model.joint_names) + 1))]
    return [
        [_mesh(visual, mesh) for visual, mesh in _visuals(links[name])] if name in links else []
        for name in names
    ]


def _visuals(
    link: ElementTree.Element,
) -> Iterator[tuple[ElementTree.Element, ElementTree.Element]]:
    for visual in link.iter('visual'):
        if (mesh := visual.find('geometry/mesh')) is not None:
            yield visual, mesh


def _mesh(visual: ElementTree.Element, mesh: ElementTree.Element) -> LinkMesh:
    name = mesh.get('filename', '').removeprefix(PACKAGE_URI)
    colour = visual.find('material/color')
    rgba = NO_COLOUR if colour is None else colour.get('rgba', NO_COLOUR)
    red, green, blue = (float(value) for value in rgba.split()[:3])
    return LinkMesh(share_folder(name), (red, green, blue))
