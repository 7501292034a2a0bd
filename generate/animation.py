# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Renders the README's animation: a pick and place that the C3 drives, beside its velocities.

python -m generate.animation [--frames FOLDER] [--only N ...]

The task, its plan and the motion are those of `demo --plan`: points from the planner, and what the
smoother makes of them with 1 s known ahead, as the simulated controller does. Nothing is drawn by
hand but colours and camera.
"""

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from PIL import Image, ImageDraw, ImageFilter, ImageFont

from epson_driver.motion import Array
from epson_driver.planning.plan import Plan, plan_task
from epson_driver.planning.shapes import Box, Shape
from epson_driver.planning.task import draw_task
from epson_driver.planning.workspace import GRIPPER_LENGTH_M, GRIPPER_RADIUS_M
from epson_driver.robots import RobotModel, load_robot_model
from generate.picture import IMAGES, bodies
from generate.render import Body, Camera, render

SEED = 5
"""Of the task: `make demo ARGS='--plan --seed 5'` drives the same one."""

FRAME, SHOWN = 0.045, 0.09
"""Time of the robot between two frames, and for how long each is shown, s: half speed."""

REST, END = 0.25, 0.4
"""How long the arm rests where it grips and lets go, and before the animation starts anew, s."""

SCENE, PLOT = (460, 500), (520, 500)
"""Sizes of the two halves, pixels."""

CAMERA = Camera(eye=(2.6, -1.5, 1.75), target=(0.18, 0.03, 0.31), height=1.09)
SAMPLES = 32
ACCENT = '#d9480f'
DRIVEN, COMING, LIMIT, TEXT, PAPER = '#1864ab', '#b6cade', '#c92a2a', '#343a40', '#f4f5f8'
PILLAR_LOOK = ((0.62, 0.68, 0.73), 0.15)
TRAY_LOOK = ((0.83, 0.79, 0.70), 0.1)
PART_LOOK = ((0.20, 0.52, 0.47), 0.25)
GRIPPER_LOOK = ((0.16, 0.17, 0.19), 0.4)
TRAIL_LOOK = ((0.85, 0.28, 0.06), 0.1)
POINT_LOOK = ((0.10, 0.10, 0.12), 0.2)


@dataclass(frozen=True, eq=False)
class Drive:
    """The whole motion, rests included: samples, planned points, and where the part is.

    times (k,) s; positions and velocities (k, n), rad and rad/s; point_times (p,), points and
    point_velocities (p, n). grip, release: when the part is taken and let go, s.
    """

    plan: Plan
    model: RobotModel
    times: Array
    positions: Array
    velocities: Array
    point_times: Array
    points: Array
    point_velocities: Array
    grip: float
    release: float

    def at(self, time: float) -> int:
        """Return the number of the sample at a time, s."""
        return int(np.clip(np.searchsorted(self.times, time), 0, len(self.times) - 1))

    def tool(self, joints: Array) -> Array:
        """Return tool0's pose in base_link, (4, 4), m."""
        return self.plan.scene.hand_pose(joints)

    def tip(self, joints: Array) -> Array:
        """Return where the gripper's end is, m."""
        pose = self.tool(joints)
        return np.asarray(pose[:3, 3] + GRIPPER_LENGTH_M * pose[:3, 2])


@cache
def drive() -> Drive:
    """Return what is shown."""
    model = load_robot_model('c3_a601s')
    plan = plan_task(draw_task(SEED, model), model)
    now = 0.0
    ends: list[float] = []
    samples: list[tuple[Array, Array, Array]] = []
    points: list[tuple[Array, Array, Array]] = []
    for motion in plan.motions:
        for parts, trajectory in ((samples, motion.expected), (points, motion.sent)):
            assert trajectory.velocities is not None
            times = now + trajectory.times - trajectory.times[0]
            parts.append((times, trajectory.positions, trajectory.velocities))
        ends.append(float(samples[-1][0][-1]))
        now = ends[-1] + REST
    times, positions, velocities = (np.concatenate(part) for part in zip(*samples, strict=True))
    when, where, how_fast = (np.concatenate(part) for part in zip(*points, strict=True))
    return Drive(
        plan,
        model,
        times,
        positions,
        velocities,
        point_times=when,
        points=where,
        point_velocities=how_fast,
        grip=ends[0] + REST / 2,
        release=ends[1] + REST / 2,
    )


def frame_times() -> Array:
    """Return the time of each frame, s."""
    return np.arange(0.0, drive().times[-1] + END, FRAME)


def frame(number: int) -> Image.Image:
    """Return one frame: the scene to the left, the curves to the right."""
    time = float(frame_times()[number])
    picture = Image.new('RGB', (SCENE[0] + PLOT[0], SCENE[1]), 'white')
    picture.paste(_scene(drive(), time), (0, 0))
    picture.paste(_curves(drive(), time), (SCENE[0], 0))
    return picture


def _scene(driven: Drive, time: float) -> Image.Image:
    joints = driven.positions[driven.at(time)]
    surfaces = [
        *bodies(driven.model, np.degrees(joints).tolist(), (0.0, 0.0, 0.0)),
        *_still(driven),
        *_held(driven, time, joints),
        *_trail(driven, time),
    ]
    rendered = Image.fromarray(render(surfaces, CAMERA, SCENE, samples=SAMPLES))
    rendered = rendered.filter(ImageFilter.MedianFilter(3))
    ImageDraw.Draw(rendered).text(
        (12, SCENE[1] - 12), 'half speed', TEXT, ImageFont.load_default(13), anchor='ls'
    )
    return rendered


def _still(driven: Drive) -> Iterator[Body]:
    """Yield what stands around the arm, and the planned points where the gripper's end passes."""
    for shape in driven.plan.task.obstacles:
        yield Body(_solid(shape), *(PILLAR_LOOK if 'pillar' in shape.name else TRAY_LOOK))
    for joints in driven.points:
        ball = trimesh.creation.icosphere(subdivisions=1, radius=0.0065)
        yield Body(ball.apply_translation(driven.tip(joints)), *POINT_LOOK)


def _solid(shape: Shape) -> trimesh.Trimesh:
    if isinstance(shape, Box):
        turned = trimesh.transformations.rotation_matrix(shape.yaw, [0, 0, 1])
        solid = trimesh.creation.box(shape.size).apply_transform(turned)
    else:
        solid = trimesh.creation.cylinder(shape.radius, shape.length, sections=64)
    return solid.apply_translation(shape.centre)


def _held(driven: Drive, time: float, joints: Array) -> Iterator[Body]:
    """Yield the gripper, and the part in it or where it stands."""
    pose = driven.tool(joints)
    gripper = trimesh.creation.cylinder(GRIPPER_RADIUS_M, GRIPPER_LENGTH_M, sections=32)
    gripper.apply_translation([0.0, 0.0, GRIPPER_LENGTH_M / 2])
    yield Body(gripper.apply_transform(pose), *GRIPPER_LOOK)
    task = driven.plan.task
    holder = task.pick if time < driven.grip else task.place if time > driven.release else pose
    part = trimesh.creation.box(task.part)
    part.apply_translation([0.0, 0.0, GRIPPER_LENGTH_M + task.part[2] / 2])
    yield Body(part.apply_transform(holder), *PART_LOOK)


def _trail(driven: Drive, time: float) -> Iterator[Body]:
    """Yield the way that the gripper's end has come."""
    known = driven.positions[: driven.at(time) + 1 : 8]
    way = [driven.tip(joints) for joints in known]
    pieces = [
        trimesh.creation.cylinder(0.003, segment=[a, b], sections=8)
        for a, b in pairwise(way)
        if np.linalg.norm(b - a) > 1e-4
    ]
    if pieces:
        yield Body(trimesh.util.concatenate(pieces), *TRAIL_LOOK)


def _curves(driven: Drive, time: float) -> Image.Image:
    """Return the velocity of each joint over the time, up to now in full colour."""
    names, limits = driven.model.limits.names, driven.model.limits.velocity
    style = {
        'font.family': 'DejaVu Sans',
        'font.size': 9,
        'axes.edgecolor': '#adb5bd',
        'text.color': TEXT,
        'axes.labelcolor': TEXT,
        'xtick.color': TEXT,
        'ytick.color': TEXT,
    }
    with mpl.rc_context(style):
        size = PLOT[0] / 100, PLOT[1] / 100
        figure, axes = plt.subplots(3, 2, sharex=True, figsize=size, dpi=100, facecolor=PAPER)
        figure.subplots_adjust(
            left=0.128, right=0.985, top=0.875, bottom=0.085, hspace=0.24, wspace=0.27
        )
        now = driven.at(time)
        for joint, (each, name, limit) in enumerate(zip(axes.T.flat, names, limits, strict=True)):
            curve = driven.velocities[:, joint]
            each.plot(driven.times, curve, color=COMING, lw=1.5)
            each.plot(driven.times[: now + 1], curve[: now + 1], color=DRIVEN, lw=2.0)
            each.plot(
                driven.point_times, driven.point_velocities[:, joint], '.', color='black', ms=3.6
            )
            each.axhline(limit, color=LIMIT, lw=1.1, ls=(0, (4, 2)))
            each.axhline(-limit, color=LIMIT, lw=1.1, ls=(0, (4, 2)))
            each.axvline(time, color=ACCENT, lw=1.0)
            each.plot(time, curve[now], 'o', color=ACCENT, ms=5)
            each.set_ylim(-1.12 * limit, 1.12 * limit)
            each.set_yticks([-limit, 0.0, limit], [f'−{limit:g}', '0', f'{limit:g}'])
            each.tick_params(length=2.5, labelsize=8)
            each.set_facecolor('white')
            each.spines[['top', 'right']].set_visible(False)
            each.set_title(name.replace('_', ' '), fontsize=9, loc='left', pad=3)
        for each in axes[-1]:
            each.set_xlim(0.0, float(frame_times()[-1]))
            each.set_xlabel('time [s]', labelpad=1)
        figure.supylabel('joint velocity [rad/s]', x=0.006, fontsize=9.5)
        handles = [
            plt.Line2D([], [], color='black', marker='.', ls='', ms=6, label='planned points'),
            plt.Line2D([], [], color=DRIVEN, lw=2, label='driven'),
            plt.Line2D([], [], color=LIMIT, lw=1.1, ls=(0, (4, 2)), label="joint's limit"),
        ]
        figure.legend(
            handles=handles,
            loc='upper center',
            bbox_to_anchor=(0.55, 1.0),
            ncols=3,
            frameon=False,
            fontsize=10,
            handletextpad=0.5,
        )
        figure.canvas.draw()
        picture = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())).convert('RGB')
        plt.close(figure)
    return picture


def main(arguments: Sequence[str] | None = None) -> None:
    """Write docs/images/drive.webp, or single frames as PNG files."""
    parser = argparse.ArgumentParser(prog='python -m generate.animation')
    parser.add_argument('--frames', type=Path, metavar='FOLDER', help='write PNG files to it')
    parser.add_argument('--only', type=int, nargs='+', metavar='N', help='of these frames')
    chosen = parser.parse_args(arguments)
    numbers = chosen.only or range(len(frame_times()))
    with ProcessPoolExecutor(2) as pool:
        frames = list(pool.map(frame, numbers))
    if chosen.frames:
        for number, picture in zip(numbers, frames, strict=True):
            picture.save(chosen.frames / f'{number:03}.png')
    if not chosen.only:
        frames[0].save(
            IMAGES / 'drive.webp',
            save_all=True,
            append_images=frames[1:],
            duration=round(1e3 * SHOWN),
            loop=0,
            quality=72,
            method=6,
        )


if __name__ == '__main__':
    main()
