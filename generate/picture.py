# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Renders the pictures of the robots in docs/images from the files in urdf/meshes.

python -m generate.picture [robot] [robots] [scaras] [meshes]
"""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import trimesh
import yaml
from PIL import Image, ImageDraw, ImageFont

from epson_driver.motion import Array
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.robots.chain import rotation_about
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.model import SCARA, SIX_AXIS
from epson_driver.share import share_folder
from generate.meshes import described_models
from generate.render import Body, Camera, project, render

IMAGES = Path(__file__).parents[1] / 'docs' / 'images'
MESHES = share_folder('urdf', 'meshes')
LOOKS = {
    'white': ((0.90, 0.90, 0.885), 0.30),
    'dark': ((0.20, 0.215, 0.235), 0.35),
    'metal': ((0.55, 0.565, 0.58), 0.6),
}
HUNG_M = 0.62
"""How high base_link of an arm is shown that hangs."""

PALE = ((0.42, 0.62, 0.80), 0.1)


def bodies(
    model: RobotModel,
    shown: Sequence[float],
    place: tuple[float, float, float],
    collision: bool = False,
    height: float = 0.0,
) -> Iterator[Body]:
    """Yield the surfaces of a robot at joint positions, degrees (mm).

    place: x, y and the angle about z, degrees, of base_link; height: its z, m.
    """
    links = yaml.safe_load((MESHES / model.name / 'links.yaml').read_text('utf-8'))
    stand = np.eye(4)
    stand[:3, :3] = rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(place[2]))
    stand[:3, 3] = *place[:2], height
    frames = [np.eye(4), *Kinematics(model).link_frames(np.array(shown) / model.shown_per_unit)]
    for frame, link in zip(frames, links.values(), strict=True):
        files = [(each['mesh'], LOOKS[each['colour']]) for each in link['visual']]
        if collision:
            files = [(each, PALE) for each in link['collision']]
        for file, (colour, gloss) in files:
            surface = trimesh.load_mesh(MESHES / file)
            surface.apply_transform(stand @ frame)
            yield Body(surface, colour, gloss)


def robot() -> Array:
    """Return the C3 in three poses: zero, reaching down to a table, stretched up and turned."""
    model = load_robot_model('c3_a601s')
    shown = (
        ([0, 0, 0, 0, 0, 0], (-0.60, 0.0, 0.0)),
        ([-28, -48, 20, 0, -62, 0], (0.10, 0.0, 0.0)),
        ([-40, 12, 48, 0, 30, 0], (0.76, 0.0, 0.0)),
    )
    scene = [body for degrees, place in shown for body in bodies(model, degrees, place)]
    camera = Camera(eye=(1.0, -3.3, 1.15), target=(0.20, -0.02, 0.41), height=0.98)
    return render(scene, camera, (1600, 720), samples=96)


def robots() -> Array:
    """Return all six-axis models side by side, from small to large, with their names."""
    camera = Camera(eye=(0.0, -7.0, 2.1), target=(0.02, 0.0, 0.47), height=1.86)
    return _side_by_side(SIX_AXIS, [-10, 12, -16, 0, -62, 0], -35.0, 0.38, camera, 500)


def scaras() -> Array:
    """Return all SCARAs side by side, and at the end those that hang, from a piece of ceiling."""
    camera = Camera(eye=(0.0, -6.0, 2.0), target=(0.0, 0.0, 0.3), height=1.3)
    return _side_by_side(SCARA, [60, 60, -50, 0], -40.0, 0.8, camera, 430)


def _side_by_side(
    kind: str, shown: Sequence[float], turn: float, room: float, camera: Camera, height: int
) -> Array:
    """Return all models of a kind at a pose, degrees (mm).

    room: how wide each is per reach; height: of the picture, pixels.
    """
    models = [model for model in described_models() if model.kind == kind]
    models.sort(key=lambda model: (_hangs(model), float(model.reach[0]), model.name))
    widths = np.array([0.22 + room * float(model.reach[0]) for model in models])
    places = np.cumsum(widths) - widths / 2.0 - np.sum(widths) / 2.0
    scene: list[Body] = []
    for model, x in zip(models, places, strict=True):
        hangs = _hangs(model)
        stand = (float(x) - _foot(model), 0.0, turn)
        parts = [*bodies(model, shown, stand, height=HUNG_M if hangs else 0.0)]
        if hangs:
            top = max(float(part.mesh.vertices[:, 2].max()) for part in parts)
            ceiling = trimesh.creation.box((0.34, 0.34, 0.03))
            ceiling.apply_translation((stand[0], 0.0, top + 0.015))
            parts.append(Body(ceiling, *LOOKS['metal']))
        scene += parts
    size = (1600, height)
    picture = Image.fromarray(render(scene, camera, size))
    draw = ImageDraw.Draw(picture)
    for model, x in zip(models, places, strict=True):
        stands = kind == SCARA and not _hangs(model)
        left = float(x) if stands else float(x) - _foot(model)
        place = project(camera, (left, -0.45, 0.0), size)
        name = model.name.upper().replace('_', '-')
        draw.text(place, name, (70, 75, 82), ImageFont.load_default(17), anchor='mt')
    return np.asarray(picture)


def _hangs(model: RobotModel) -> bool:
    return model.kind == SCARA and bool(model.chain.origins[1, 2] < 0.0)


def _foot(model: RobotModel) -> float:
    """Return how far to the left of its middle an arm's base is shown, m."""
    return 0.1 if model.kind == SIX_AXIS else 0.35 * float(model.reach[0])


def meshes() -> Array:
    """Return the C3's visual meshes and its collision meshes side by side."""
    model = load_robot_model('c3_a601s')
    degrees = [-25, -20, 12, 0, -45, 0]
    scene = [
        *bodies(model, degrees, (-0.42, 0.0, 0.0)),
        *bodies(model, degrees, (0.26, 0.0, 0.0), collision=True),
    ]
    camera = Camera(eye=(0.9, -2.9, 1.05), target=(0.08, -0.03, 0.33), height=0.84)
    return render(scene, camera, (1200, 700))


PICTURES = {'robot': robot, 'robots': robots, 'scaras': scaras, 'meshes': meshes}


def main(names: list[str]) -> None:
    """Write the pictures of these names, or all."""
    for name in names or PICTURES:
        picture = Image.fromarray(PICTURES[name]())
        picture.quantize(256, dither=Image.Dither.NONE).save(IMAGES / f'{name}.png', optimize=True)


if __name__ == '__main__':
    main(sys.argv[1:])
