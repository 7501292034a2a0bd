# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""URDF, SRDF and surfaces of a model.

xacro generates the URDF and the SRDF from the model's data and the files in urdf/.
"""

import contextlib
import hashlib
import json
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise, product
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from epson_driver.inputs import MEGABYTE, read_file, write_file
from epson_driver.motion import Array
from epson_driver.robots.catalogue import layers, model_name
from epson_driver.robots.chain import Frame
from epson_driver.robots.model import RobotModel
from epson_driver.share import share_path


def cached(made_of: Iterable[bytes], make: Callable[[], str]) -> str:
    """Return the text that `make` generates from the bytes `made_of`, or its copy in the cache.

    Without a usable cache folder, the text is generated each time. Files are written atomically,
    so other processes never read an incomplete file.
    """
    key = hashlib.sha256()
    for part in made_of:
        key.update(hashlib.sha256(part).digest())
    path = _folder() / key.hexdigest()
    with contextlib.suppress(ValueError):
        digest, _, text = read_file(path, 10 * MEGABYTE).decode().partition('\n')
        if digest == _digest(text):
            return text
    text = make()
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, f'{_digest(text)}\n{text}')
    return text


def _folder() -> Path:
    chosen = Path(os.environ.get('XDG_CACHE_HOME', ''))  # a relative path is ignored
    try:
        home = chosen if chosen.is_absolute() else Path.home() / '.cache'
    except RuntimeError:  # a user without a home
        home = Path(os.devnull)  # nothing can be created in it
    return home / 'epson_driver'


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode('utf-8')).hexdigest()


_ONE_AT_A_TIME = threading.Lock()
"""Lock for xacro, which keeps its state in global variables."""


def urdf(robot_model: str, **arguments: str) -> str:
    """Return the URDF of a model.

    `robot_model` is a name or path for `load_robot_model`. `arguments` are passed to
    urdf/epson_robot.urdf.xacro. Raises ImportError if xacro is missing, and InputError if the
    model or an argument is invalid.
    """
    return _described('epson_robot.urdf.xacro', robot_model, arguments)


def srdf(robot_model: str, **arguments: str) -> str:
    """Return a model's SRDF, MoveIt's semantic description, with the group `manipulator`."""
    return _described('epson_robot.srdf.xacro', robot_model, arguments)


def _described(xacro_file: str, robot_model: str, arguments: dict[str, str]) -> str:
    named = model_name(robot_model)
    files = {layer.path: read_file(layer.path, MEGABYTE) for layer in layers(named)}
    if named.endswith('.yaml'):
        named = str(Path(named).absolute())
    mappings = {**arguments, 'robot_model': named}
    sources = [path.read_bytes() for path in sorted(share_path('urdf').glob('*.xacro'))]
    words = json.dumps([xacro_file, mappings], sort_keys=True).encode()
    return cached(
        [words, *files.values(), *sources],
        lambda: _made(str(share_path('urdf') / xacro_file), mappings),
    )


def _made(path: str, mappings: dict[str, str]) -> str:
    import xacro

    with _ONE_AT_A_TIME:
        root = xacro.process_file(path, mappings=mappings).documentElement
        return str(root.toprettyxml(indent='  '))


SIDES = 24

EDGE_M = 0.004
"""Maximum width of bevelled edges, m. The bevels make the edges visible."""

EDGE_SHARE = 0.12
"""Maximum width of bevelled edges as a fraction of the solid's smallest dimension."""


class Surface(NamedTuple):
    """Triangles of one colour in a link's frame, shape (n, 3, 3), m.

    Their corners are counter-clockwise when seen from outside.
    """

    corners: npt.NDArray[np.float32]
    colour: tuple[float, float, float]


def link_surfaces(model: RobotModel) -> list[list[Surface]]:
    """Return the surfaces of base_link and of each link: one surface for each colour."""
    root = ElementTree.fromstring(urdf(model.file))  # noqa: S314 - made by us
    links = {link.get('name'): link for link in root.iter('link')}
    numbers = range(1, len(model.joint_names) + 1)
    names = ['base_link_inertia', *(f'link_{number}' for number in numbers)]
    return [_by_colour(links[name]) for name in names]


def _by_colour(link: ElementTree.Element) -> list[Surface]:
    result: dict[tuple[float, float, float], list[Array]] = {}
    for visual in link.iter('visual'):
        red, green, blue, _ = _numbers(visual.find('material/color'), 'rgba')
        result.setdefault((red, green, blue), []).extend(_solids(visual))
    return [
        Surface(np.concatenate(corners).astype(np.float32), colour)
        for colour, corners in result.items()
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
    """Return the triangles of a box about its centre, shape (n, 3, 3), m.

    The edges are bevelled.
    """
    half = np.array([x, y, z]) / 2.0
    bevel = _bevel(2.0 * float(half.min()))
    # at each corner a point on each of the three faces
    points = {
        (signs, axis): np.array(signs) * (half - bevel * (np.arange(3) != axis))
        for signs in product((-1, 1), repeat=3)
        for axis in range(3)
    }
    polygons = [[points[signs, axis] for axis in range(3)] for signs in product((-1, 1), repeat=3)]
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        for side, other in product((-1, 1), repeat=2):
            low, high = np.zeros((2, 3), dtype=int)
            low[[axis, one, two]], high[[axis, one, two]] = (-1, side, other), (1, side, other)
            a, b = tuple(low.tolist()), tuple(high.tolist())
            polygons.append([points[a, one], points[b, one], points[b, two], points[a, two]])
        for side in (-1, 1):
            ring = []
            for around in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                signs = np.zeros(3, dtype=int)
                signs[[axis, one, two]] = (side, *around)
                ring.append(points[tuple(signs.tolist()), axis])
            polygons.append(ring)
    return _fans(polygons)


def cylinder(radius: float, length: float) -> Array:
    """Return the triangles of a cylinder about the z axis, shape (n, 3, 3), m.

    Its edges are bevelled.
    """
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
    """Return the triangles of a convex solid around the origin, shape (n, 3, 3), facing outwards.

    `polygons` are the faces of the solid.
    """
    corners = np.array(
        [(ring[0], ring[i], ring[i + 1]) for ring in polygons for i in range(1, len(ring) - 1)]
    )
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum('ij,ij->i', normals, corners[:, 0]) < 0.0
    corners[inwards] = corners[inwards][:, ::-1]
    return corners


def _numbers(element: ElementTree.Element | None, key: str) -> list[float]:
    return [] if element is None else [float(word) for word in element.get(key, '').split()]
