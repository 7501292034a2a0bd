# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Writes urdf/meshes: what an arm looks like, and convex solids around it.

    python -m generate.meshes

NAME/visual/LINK_COLOUR.stl and NAME/collision/LINK_i.stl are in m, in the link's frame.
NAME/links.yaml tells the xacro which files belong to a link (a link that two models have in common
is stored once) and how its share of the arm's mass is spread.
"""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import trimesh
from manifold3d import Manifold, Mesh, OpType

from epson_driver.motion import Array
from epson_driver.robots import RobotModel, load_robot_model, robot_models
from epson_driver.robots.model import SCARA, SIX_AXIS
from epson_driver.share import share_folder
from generate import scara_links
from generate.dimensions import MM, Dimensions, dimensions
from generate.hulls import few_faces
from generate.links import LEFT, LINKS, RIGHT, Piece
from generate.scara_links import ScaraDimensions, scara_dimensions
from generate.shapes import mirrored

FIRST = 'c3_a601s'
"""The model that is generated first; it owns the files that others share with it."""

MIN_DETAIL_MM = 0.15
"""Smaller details are left out."""


@dataclass(frozen=True)
class Link:
    """One link: solids by colour, the convex parts around them, and how its mass is spread.

    share: of the arm's mass. centre: its centre in the link's frame, m. per_kg: inertia about the
    centre per kg, xx, xy, xz, yy, yz, zz, m².
    """

    visual: dict[str, trimesh.Trimesh]
    collision: list[trimesh.Trimesh]
    share: float = 0.0
    centre: Array = field(default_factory=lambda: np.zeros(3))
    per_kg: Array = field(default_factory=lambda: np.zeros(6))


def described_models() -> list[RobotModel]:
    """Return the models for which meshes are made, FIRST first, then by kind and name."""
    models = [load_robot_model(name) for name in robot_models()]
    return sorted(
        (model for model in models if model.kind in (SIX_AXIS, SCARA)),
        key=lambda model: (model.name != FIRST, model.kind != SIX_AXIS, model.name),
    )


def links(model: RobotModel) -> dict[str, Link]:
    """Return all links of a model. Raises ValueError for one that is built otherwise."""
    return _links(scara_dimensions(model) if model.kind == SCARA else dimensions(model))


@cache
def _links(sizes: Dimensions | ScaraDimensions) -> dict[str, Link]:
    raw = {name: _link(pieces) for name, pieces in _pieces(sizes).items()}
    total = sum(link.volume for link in raw.values())
    return {
        name: Link(
            visual=link.visual,
            collision=link.collision,
            share=link.volume / total,
            centre=link.centre,
            per_kg=link.per_kg,
        )
        for name, link in raw.items()
    }


def _pieces(sizes: Dimensions | ScaraDimensions) -> dict[str, list[Piece]]:
    if isinstance(sizes, ScaraDimensions):
        return {name: list(pieces(sizes)) for name, pieces in scara_links.LINKS.items()}
    return {name: list(pieces(sizes)) for name, pieces in LINKS.items()}


@dataclass(frozen=True)
class _RawLink:
    visual: dict[str, trimesh.Trimesh]
    collision: list[trimesh.Trimesh]
    volume: float
    centre: Array
    per_kg: Array


def _link(pieces: list[Piece]) -> _RawLink:
    colours = sorted({piece.colour for piece in pieces}, reverse=True)
    parts = sorted({piece.part for piece in pieces})
    visual = {
        colour: mesh(
            _union([each.solid for each in pieces if each.colour == colour]).simplify(
                MIN_DETAIL_MM
            )
        )
        for colour in colours
    }
    around = [
        few_faces(
            _union([each.solid for each in pieces if each.part == part]), symmetric=part != LEFT
        )
        for part in parts
        if part != RIGHT
    ]
    if RIGHT in parts:  # the last one, after LEFT
        around.append(mirrored(around[-1]))
    whole = mesh(_union(around))
    inertia = whole.moment_inertia / whole.volume
    return _RawLink(
        visual=visual,
        collision=[mesh(each) for each in around],
        volume=float(whole.volume),
        centre=whole.center_mass,
        per_kg=inertia[np.triu_indices(3)],
    )


def _union(solids: list[Manifold]) -> Manifold:
    return Manifold.batch_boolean(solids, OpType.Add)


def mesh(solid: Manifold) -> trimesh.Trimesh:
    """Return the surface of a solid, m, in single precision as in the files."""
    surface: Mesh = solid.to_mesh()
    vertices = np.round(np.asarray(surface.vert_properties, dtype=float)[:, :3], 3) / MM
    return trimesh.Trimesh(vertices.astype(np.float32), surface.tri_verts, process=True)


def sharing(
    models: list[RobotModel],
) -> Iterator[tuple[RobotModel, dict[str, Link], dict[str, str]]]:
    """Yield each model with its links, and where each link's files are: MODEL/…/LINK."""
    owners: dict[bytes, str] = {}
    for model in models:
        made = links(model)
        homes = {}
        for name, link in made.items():
            key = b''.join(each.export(file_type='stl') for each in _all(link))
            homes[name] = owners.setdefault(key, model.name)
        yield model, made, homes


def _all(link: Link) -> list[trimesh.Trimesh]:
    return [*link.visual.values(), *link.collision]


def visual_file(home: str, link: str, colour: str) -> str:
    """Return the path of a visual mesh below urdf/meshes."""
    return f'{home}/visual/{link}_{colour}.stl'


def collision_file(home: str, link: str, part: int) -> str:
    """Return the path of a collision mesh below urdf/meshes."""
    return f'{home}/collision/{link}_{part}.stl'


def description(made: dict[str, Link], homes: dict[str, str]) -> str:
    """Return the text of a model's links.yaml."""
    lines = [
        '# Made by generate/meshes.py. Paths are below urdf/meshes; inertial: share of the mass',
        '# (which is in config/robots), centre, m; xx, xy, xz, yy, yz, zz about it, m2 (per kg).',
    ]
    for name, link in made.items():
        home = homes[name]
        lines += [f'{name}:', '  visual:']
        for colour in link.visual:
            lines.append(f'  - {{mesh: {visual_file(home, name, colour)}, colour: {colour}}}')
        lines.append('  collision:')
        lines += [f'  - {collision_file(home, name, i)}' for i in range(len(link.collision))]
        lines.append('  inertial:')
        lines.append(f'    share: {link.share:.4f}')
        lines.append(f'    xyz: {_list(link.centre, 5)}')
        lines.append(f'    per_kg: {_list(link.per_kg, 7)}')
    return '\n'.join(lines) + '\n'


def _list(values: Array, digits: int) -> str:
    return '[' + ', '.join(f'{round(float(v), digits) + 0.0:.{digits}f}' for v in values) + ']'


def write(folder: Path, models: list[RobotModel]) -> None:
    """Write all meshes and links.yaml files of the models; the old ones are removed."""
    shutil.rmtree(folder, ignore_errors=True)
    for model, made, homes in sharing(models):
        for name, link in made.items():
            if homes[name] == model.name:
                files = {visual_file(model.name, name, c): each for c, each in link.visual.items()}
                for part, each in enumerate(link.collision):
                    files[collision_file(model.name, name, part)] = each
                for path, each in files.items():
                    (folder / path).parent.mkdir(parents=True, exist_ok=True)
                    (folder / path).write_bytes(each.export(file_type='stl'))
        (folder / model.name).mkdir(parents=True, exist_ok=True)
        (folder / model.name / 'links.yaml').write_text(description(made, homes), 'utf-8')


if __name__ == '__main__':
    write(share_folder('urdf', 'meshes'), described_models())
