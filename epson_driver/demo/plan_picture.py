# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The picture of an executed plan: the arm among the obstacles, and the recorded joint states.

Triangles become an image by the nearest one at each pixel, in parallel projection.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np

from epson_driver.motion import Array
from epson_driver.planning.plan import MOTION_MARGIN_M, Plan
from epson_driver.planning.triangles import Picture, Triangles, joined
from epson_driver.planning.verdict import Verdict
from epson_driver.report.measure import Figures, Recording
from epson_driver.report.smooth_study import COLOURS, per_unit, save_picture
from epson_driver.robots import RobotModel

LIGHT = np.array([0.45, -0.35, 0.82]) / np.linalg.norm([0.45, -0.35, 0.82])
"""Where the light comes from."""


def view(azimuth: float, elevation: float) -> Array:
    """Return right, up and towards the eye as rows, (3, 3), for an eye in that direction, rad."""
    eye = (cos(elevation) * cos(azimuth), cos(elevation) * sin(azimuth), sin(elevation))
    right = (-sin(azimuth), cos(azimuth), 0.0)
    return np.array([right, np.cross(eye, right), eye])


def rasterised(
    corners: Array,
    colours: Array,
    axes: Array,
    extent: tuple[float, float, float, float],
    size: int,
) -> Array:
    """Return an image, (h, w, 4), RGB and opacity from 0 to 1, the first row at the bottom.

    corners: shape (k, 3, 3), counter-clockwise from outside; colours: (k, 3). axes: a `view`.
    extent: left, right, bottom, top of what is shown along the first two of them, m. size: w.
    """
    left, right, bottom, top = extent
    scale = size / (right - left)
    image = np.zeros((round(scale * (top - bottom)), size, 4))
    depth = np.full(image.shape[:2], -np.inf)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = normals @ axes[2] > 1e-12
    normals = normals[facing] / np.linalg.norm(normals[facing], axis=1)[:, None]
    light = 0.6 + 0.4 * np.clip(normals @ LIGHT, 0.0, 1.0)
    shades = np.clip(colours[facing] * light[:, None], 0.0, 1.0)
    seen = (corners[facing] @ axes.T - (left, bottom, 0.0)) * (scale, scale, 1.0)
    lows = np.clip(np.floor(seen[..., :2].min(axis=1)).astype(int), 0, None)
    highs = np.ceil(seen[..., :2].max(axis=1)).astype(int) + 1
    for triangle, shade, (x0, y0), (x1, y1) in zip(seen, shades, lows, highs, strict=True):
        spot = depth[y0:y1, x0:x1]
        if not spot.size:
            continue
        y, x = np.ogrid[y0 : y0 + spot.shape[0], x0 : x0 + spot.shape[1]]
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangle
        double = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if double < 1e-9:
            continue
        b = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / double
        c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / double
        near = az + b * (bz - az) + c * (cz - az)
        drawn = (b >= 0.0) & (c >= 0.0) & (b + c <= 1.0) & (near > spot)
        spot[drawn] = near[drawn]
        image[y0:y1, x0:x1][drawn] = (*shade, 1.0)
    return image


def halved(image: Array) -> Array:
    """Return an image of half the size, its edges smooth."""
    height, width = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    small: Array = image[:height, :width].reshape(height // 2, 2, width // 2, 2, 4)
    weight = small[..., 3:]
    total = weight.sum(axis=(1, 3))
    colour = (small[..., :3] * weight).sum(axis=(1, 3)) / np.maximum(total, 1e-9)
    return np.concatenate([colour, total / 4.0], axis=-1)


EYE = view(np.radians(14.0), np.radians(40.0))
"""The picture is seen from in front of the robot and above."""

WIDTH_PIXELS = 1400
"""Width of the scene before it is halved."""

PATHS = ('#0072B2', '#D55E00', '#009E73')
"""Colours of the three motions."""

FADING = 0.5
"""How much the arm's colour fades for the moments before and after the one in the middle."""


@dataclass(frozen=True, eq=False)
class Executed:
    """A plan and its execution, motion by motion."""

    plan: Plan
    recordings: tuple[Recording, ...]
    verdicts: tuple[Verdict, ...]
    figures: tuple[Figures, ...]

    @property
    def moved(self) -> float:
        """How long the arm moved, s."""
        return sum(figures.moved for figures in self.figures)

    @property
    def nearest(self) -> float:
        """The smallest distance to an obstacle, m."""
        return float(min(verdict.clearances.min() for verdict in self.verdicts))


def draw(path: Path, executed: Executed, model: RobotModel) -> None:
    """Write the picture."""
    import matplotlib as mpl

    mpl.use('Agg')
    from matplotlib import pyplot as plt

    figure, axes = plt.subplot_mosaic(
        [['scene', 'velocity'], ['scene', 'clearance']],
        figsize=(14, 7.2),
        layout='constrained',
        gridspec_kw={'width_ratios': (1.15, 1), 'height_ratios': (1.35, 1)},
    )
    axes['clearance'].sharex(axes['velocity'])
    _draw_scene(axes['scene'], executed)
    _draw_time(axes['velocity'], axes['clearance'], executed, model)
    figure.suptitle(
        f'Seed {executed.plan.task.seed}: planned around {len(executed.plan.task.obstacles)} '
        f'obstacles, {executed.moved:.2f} s of motion, never nearer to one than '
        f'{executed.nearest * 1e3:.1f} mm (from the joint states)',
        fontsize=11.5,
    )
    save_picture(path, figure)


def _draw_scene(axes: Any, executed: Executed) -> None:
    scene, task = executed.plan.scene, executed.plan.task
    picture = Picture(scene)
    there, carried, back = (recording.positions for recording in executed.recordings)
    tools = [
        np.array([scene.hand_pose(joints)[:3, 3] for joints in positions]) @ EYE.T
        for positions in (there, carried, back)
    ]
    corners, colours = joined(
        (
            _paler(picture.arm(there[-1], holds=False)),
            picture.arm(carried[len(carried) // 2], holds=True),
            _paler(picture.arm(carried[-1], holds=False)),
            picture.part(task.pick),
            _paler(picture.part(task.place)),
            picture.obstacles(),
        )
    )
    left, bottom, _ = (corners @ EYE.T).min(axis=(0, 1)) - 0.05
    right, top, _ = (corners @ EYE.T).max(axis=(0, 1)) + 0.05
    table = picture.table()
    image = rasterised(
        np.concatenate([corners, table[0]]),
        np.concatenate([colours, table[1]]),
        EYE,
        (left, right, bottom, top),
        WIDTH_PIXELS,
    )
    axes.imshow(
        halved(image), origin='lower', extent=(left, right, bottom, top), interpolation='bilinear'
    )
    for (across, up, _), colour, name in zip(
        (tool.T for tool in tools), PATHS, ('to the part', 'with the part', 'home'), strict=True
    ):
        axes.plot(across, up, color='white', linewidth=4.0)
        axes.plot(across, up, color=colour, linewidth=2.0, label=name)
    axes.set_aspect('equal')
    axes.set_axis_off()
    axes.legend(loc='lower left', fontsize=9, title='path of tool0', alignment='left')
    axes.set_title('at the part, half-way to its place (in full colour), and there', fontsize=10.5)


def _paler(triangles: Triangles) -> Triangles:
    corners, colours = triangles
    return corners, colours + FADING * (1.0 - colours)


def _draw_time(velocity: Any, clearance: Any, executed: Executed, model: RobotModel) -> None:
    begin = executed.figures[0].begin
    for number, (recording, verdict) in enumerate(
        zip(executed.recordings, executed.verdicts, strict=True)
    ):
        times = recording.times - begin
        for joint, name in enumerate(model.joint_names):
            velocity.plot(
                times,
                recording.velocities[:, joint],
                color=COLOURS[joint % len(COLOURS)],
                linewidth=1.3,
                label=name if number == 0 else None,
            )
        clearance.plot(times, verdict.clearances * 1e3, color='#444444', linewidth=1.5)
    _shade((velocity, clearance), executed, begin)
    clearance.axhline(MOTION_MARGIN_M * 1e3, color='#D55E00', linestyle=':', linewidth=1.2)
    clearance.text(
        0.005,
        MOTION_MARGIN_M * 1e3,
        f' what a plan keeps: {MOTION_MARGIN_M * 1e3:g} mm',
        transform=clearance.get_yaxis_transform(),
        color='#D55E00',
        fontsize=8.5,
        verticalalignment='bottom',
    )
    velocity.set_ylabel(f'velocity [{per_unit(model.limits, "/s")}]')
    clearance.set_ylabel('distance to obstacles [mm]')
    clearance.set_xlabel('time [s]')
    clearance.set_ylim(bottom=0.0)
    clearance.set_title('shaded: with the part in the hand', fontsize=9.5)
    velocity.legend(
        loc='upper center',
        ncols=len(model.joint_names),
        fontsize=8,
        frameon=False,
        handlelength=1.2,
    )
    low, high = velocity.get_ylim()
    velocity.set_ylim(low, high + 0.14 * (high - low))
    for axes in (velocity, clearance):
        axes.grid(alpha=0.3)
        axes.set_xlim(left=-0.15)


def _shade(plots: Iterable[Any], executed: Executed, begin: float) -> None:
    """Shade the time during which the gripper holds the part."""
    carrying = executed.recordings[1].times - begin
    for axes in plots:
        axes.axvspan(carrying[0], carrying[-1], color='#E69F00', alpha=0.12, linewidth=0.0)
