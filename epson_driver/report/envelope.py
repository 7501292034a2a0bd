# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Plots the workspace of an arm: a SCARA from above, a six-axis arm from the side."""

from pathlib import Path

import numpy as np

from epson_driver.motion import Array
from epson_driver.report.smooth_study import save_picture
from epson_driver.robots import RobotModel
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.model import SCARA, SIX_AXIS

STEPS = 121
"""Number of sampled positions of each of the two joints that span the workspace."""

SHOWN = {SCARA: (45.0, 60.0, 0.0, 0.0), SIX_AXIS: (0.0, -30.0, 10.0, 0.0, -60.0, 0.0)}
"""Joint positions of the drawn arm, degrees and mm."""


class PictureError(RuntimeError):
    """A plot cannot be drawn. The text is the reason."""


def draw_envelope(path: Path, model: RobotModel) -> None:
    """Write the plot of the positions that an arm reaches, in EPSON's world frame, mm.

    A SCARA is plotted in X and Y of its tool. A six-axis arm is plotted in Y and Z of its wrist,
    to which EPSON's reach refers, with joint 1 at 0. Raises PictureError if the arm is of another
    kind, or if matplotlib is missing.
    """
    if model.kind not in SHOWN:
        raise PictureError(f'{model.name} ({model.kind}): this kind of arm cannot be plotted')
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise PictureError('plots need matplotlib: pip install epson_driver[report]') from error
    scara = model.kind == SCARA
    first, across, up, last = (0, 0, 1, -1) if scara else (1, 1, 2, 4)
    arm, limits = Kinematics(model), model.limits

    def in_picture(frames: Array) -> Array:
        """Return the plotted coordinates of frames, mm, shape (…, 2). frames: shape (…, 4, 4)."""
        return np.asarray(arm.in_base(frames)[..., [across, up], 3] * 1e3)

    one, two = (
        [arm.link_frames(value * np.eye(len(limits.names))[joint]) for value in values]
        for joint, values in (
            (joint, np.linspace(limits.position_min[joint], limits.position_max[joint], STEPS))
            for joint in (first, first + 1)
        )
    )
    turns = np.array([frames[first] for frames in one]) @ np.linalg.inv(two[0][first])
    area = in_picture(turns[:, None] @ np.array([frames[last] for frames in two]))
    shown = np.array(SHOWN[model.kind]) / model.shown_per_unit
    shown = in_picture(arm.link_frames(shown if scara else model.for_folding_arm(shown.tolist())))
    if not scara:
        shown = np.vstack([[0.0, 0.0], shown])

    mpl.use('Agg')
    from matplotlib import pyplot as plt
    from matplotlib.colors import ListedColormap

    figure, axes = plt.subplots(figsize=(7, 7), layout='constrained')
    blue = ListedColormap(['#B7D3E8'])
    axes.pcolormesh(
        area[..., 0],
        area[..., 1],
        np.zeros((STEPS, STEPS)),
        cmap=blue,
        shading='gouraud',
        rasterized=True,
    )
    axes.plot(*shown.T, 'o-', color='#33373C', linewidth=5, markersize=8, solid_capstyle='round')
    axes.set_aspect('equal')
    axes.grid(alpha=0.4)
    x, y = ('X', 'Y') if scara else ('Y', 'Z')
    axes.set_xlabel(f'{x} of EPSON’s world, mm')
    axes.set_ylabel(f'{y}, mm')
    ranges = ', '.join(
        f'J{joint + 1} {low:.5g} … {high:.5g}°'
        for joint, (low, high) in enumerate(
            np.degrees(np.stack([limits.position_min, limits.position_max], axis=1))
        )
        if joint in (first, first + 1)
    )
    stroke = f', stroke {-1e3 * limits.position_min[2]:.4g} mm' if scara else ''
    away = area - shown[0]
    reach = np.hypot(away[..., 0], away[..., 1]).max() if scara else away[..., 0].max()
    name = model.name.upper().replace('_', '-')
    axes.set_title(f'{name}: reach {reach:.0f} mm, {ranges}{stroke}', fontsize=11)
    save_picture(path, figure)
