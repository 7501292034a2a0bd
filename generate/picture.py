# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Renders the pictures of the robots in docs/images from their data.

python -m generate.picture [robot] [arms]
"""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image, ImageDraw, ImageFont

from epson_driver.motion import Array
from epson_driver.robots import RobotModel, load_robot_model, robot_models
from epson_driver.robots.chain import rotation_about
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.link_surfaces import link_surfaces
from epson_driver.robots.model import SCARA, SIX_AXIS
from generate.render import Body, Camera, render

IMAGES = Path(__file__).parents[1] / 'docs' / 'images'
METAL = (0.55, 0.565, 0.58)


def bodies(
    model: RobotModel,
    shown: Sequence[float],
    place: tuple[float, float, float],
) -> Iterator[Body]:
    """Yield the surfaces of a robot at joint positions, degrees (mm).

    place: x, y and the angle about z, degrees, of base_link.
    """
    stand = np.eye(4)
    stand[:3, :3] = rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(place[2]))
    stand[:2, 3] = place[:2]
    frames = [np.eye(4), *Kinematics(model).link_frames(np.array(shown) / model.shown_per_unit)]
    for frame, link in zip(frames, link_surfaces(model), strict=True):
        for corners, colour in link:
            gloss = 0.6 if colour == METAL else 0.3
            surface = trimesh.Trimesh(**trimesh.triangles.to_kwargs(corners))
            surface.merge_vertices()
            yield Body(surface.apply_transform(stand @ frame), colour, gloss)


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


ARMS_PER_M, ARMS_WIDE, ARMS_ROW, ARMS_EDGE = 110.0, 1600, 210, 24.0
"""Of the picture of all arms: pixels per m, how wide it is, how high a row, and its edges."""


def arms() -> Array:
    """Return all models in rows, to one scale, seen from the front and above; painted, not lit."""
    models = sorted(map(load_robot_model, robot_models()), key=lambda each: (each.kind, each.name))
    rows: list[list[tuple[RobotModel, float]]] = [[]]
    x = ARMS_EDGE
    for model in models:
        wide = max(0.35 * ARMS_PER_M + 0.75 * ARMS_PER_M * float(model.reach[0]), 84.0)
        if x + wide > ARMS_WIDE - ARMS_EDGE:
            rows.append([])
            x = ARMS_EDGE
        rows[-1].append((model, x + wide / 2))
        x += wide
    picture = Image.new('RGB', (2 * ARMS_WIDE, 2 * ARMS_ROW * len(rows)), (246, 247, 248))
    draw = ImageDraw.Draw(picture)
    for number, row in enumerate(rows):
        for model, middle in row:
            hangs, name = _hangs(model), model.name.upper().replace('_', '-')
            _paint(draw, model, (2 * middle, 2 * (ARMS_ROW * number + (25 if hangs else 175))))
            place = (2 * middle, 2 * (ARMS_ROW * number + 190))
            draw.text(place, name, (70, 75, 82), ImageFont.load_default(22), anchor='mt')
    return np.asarray(picture.resize((ARMS_WIDE, ARMS_ROW * len(rows)), Image.Resampling.LANCZOS))


def _paint(draw: ImageDraw.ImageDraw, model: RobotModel, foot: tuple[float, float]) -> None:
    """Draw a model's triangles, the farthest first; foot: where its base is, pixels."""
    if model.kind == SCARA:
        shown = [60, 60, -50, 0]
    else:
        shown = np.degrees(model.bent(np.radians([-10, 12, -16, 0, -62, 0]).tolist())).tolist()
    tilt = rotation_about(np.array([1.0, 0.0, 0.0]), np.radians(15.0))
    triangles, colours = [], []
    for body in bodies(model, shown, (-_foot(model), 0.0, -35.0)):
        triangles.append(body.mesh.triangles @ tilt.T)
        colours.append(np.tile(body.colour, (len(triangles[-1]), 1)))
    corners, colour = np.concatenate(triangles), np.concatenate(colours)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12
    light = 0.55 + 0.45 * np.clip(normals @ np.array([-0.4, -0.6, 0.7]), 0.0, 1.0)
    shades = np.clip(255 * colour * light[:, None], 0, 255).astype(int)
    for index in np.argsort(-corners[:, :, 1].mean(axis=1)):
        if normals[index, 1] < 0.0:  # the others look away
            flat = corners[index] * 2.0 * ARMS_PER_M
            points = [(foot[0] + x, foot[1] - z) for x, _, z in flat.tolist()]
            draw.polygon(points, fill=tuple(shades[index].tolist()))


def _hangs(model: RobotModel) -> bool:
    return bool(model.chain.origins[:, 2].sum() < 0.0)


def _foot(model: RobotModel) -> float:
    """Return how far to the left of its middle an arm's base is shown, m."""
    return 0.1 if model.kind == SIX_AXIS else 0.35 * float(model.reach[0])


PICTURES = {'robot': robot, 'arms': arms}


def main(names: list[str]) -> None:
    """Write the pictures of these names, or all."""
    for name in names or PICTURES:
        picture = Image.fromarray(PICTURES[name]())
        picture.quantize(256, dither=Image.Dither.NONE).save(IMAGES / f'{name}.png', optimize=True)


if __name__ == '__main__':
    main(sys.argv[1:])
