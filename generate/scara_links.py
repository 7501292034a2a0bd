# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The shape of each link of a SCARA, in its own frame, mm.

Lengths and heights of the joints follow the chain; all else is made up, after what such arms look
like. Each arm lies above the one before it; those of a hanging SCARA, below, so that the second
one passes under the base. Nothing here is measured.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from epson_driver.robots import RobotModel
from generate.dimensions import MM
from generate.links import BACK, DARK, METAL, WHITE, Piece
from generate.shapes import Solid, bolts, box, casting, drum


@dataclass(frozen=True)
class ScaraDimensions:
    """Lengths in mm. Each arm's shape is made along x and turned by its angle, degrees, about z.

    base: height of joint 1's frame. arm_1, arm_2: from axis to axis. rise: of joint 2 over joint 1
    (below it, if negative: the arm hangs). drop: from joint 2 down to the end of the shaft.
    stroke: of the shaft. thickness: 1 for the smallest one, the measure of what the chain does not
    tell.
    """

    base: float
    arm_1: float
    angle_1: float
    rise: float
    arm_2: float
    angle_2: float
    drop: float
    stroke: float
    thickness: float

    @property
    def hangs(self) -> bool:
        """Whether the arms are below the base."""
        return self.rise < 0.0

    @property
    def housing(self) -> tuple[float, float]:
        """From where to where the second arm's housing goes, which holds the whole shaft."""
        height = self.stroke + 50.0
        bottom = -height if self.hangs else 30.0 * self.thickness
        return bottom, bottom + height


def scara_dimensions(model: RobotModel) -> ScaraDimensions:
    """Return the lengths of a SCARA model. Raises ValueError if it is built otherwise."""
    origins = model.chain.origins * MM
    upright = np.abs(model.chain.axes - [0.0, 0.0, 1.0]).max() < 1e-9
    if not upright or np.abs(origins[[0, 3], :2]).max() > 1e-6 or abs(origins[3, 2]) > 1e-6:
        raise ValueError(f'{model.name}: no mesh can be made for this chain')
    lengths = np.hypot(*origins[1:3, :2].T)
    angles = np.degrees(np.arctan2(origins[1:3, 1], origins[1:3, 0]))
    base, rise = float(origins[0, 2]), float(origins[1, 2])
    size = np.sqrt(lengths[1] / 175.0 if rise < 0.0 else base / 156.0)
    return ScaraDimensions(
        base=base,
        arm_1=round(float(lengths[0]), 6),
        angle_1=round(float(angles[0]), 6),
        rise=rise,
        arm_2=round(float(lengths[1]), 6),
        angle_2=round(float(angles[1]), 6),
        drop=float(origins[2, 2]),
        stroke=round(-float(model.limits.position_min[2]) * MM, 3),
        thickness=round(float(np.clip(size, 0.8, 1.4)), 2),
    )


def base_link(d: ScaraDimensions) -> Iterator[Piece]:
    """A foot, the column with the bearing of joint 1, and the connector box behind."""
    t, top = d.thickness, d.base
    if d.hangs:
        yield Piece(WHITE, drum('z', (0, 0, 0), 78 * t, (top + 3.0, top + 91.3 * t), edge=7 * t))
        yield Piece(DARK, drum('z', (0, 0, 0), 62 * t, (top - 1.0, top + 8.0), ends='none'))
        plate = box((-95 * t, 95 * t), (-95 * t, 95 * t), (top + 83 * t, top + 101 * t), 5 * t)
        yield Piece(WHITE, plate, BACK)
        return
    foot = box((-150 * t, 70 * t), (-68 * t, 68 * t), (0.0, 16 * t), edge=4 * t)
    yield Piece(WHITE, foot)
    column = casting(
        drum('z', (0, 0, 0), 60 * t, (8 * t, 30 * t), edge=6 * t),
        drum('z', (0, 0, 0), 58 * t, (top - 40 * t, top - 4.0), edge=6 * t),
    )
    yield Piece(WHITE, column, 1)
    yield Piece(DARK, drum('z', (0, 0, 0), 50 * t, (top - 10.0, top + 1.0), ends='none'), 1)
    back = box((-140 * t, -20 * t), (-56 * t, 56 * t), (6 * t, 0.68 * top), edge=8 * t)
    yield Piece(WHITE, back, BACK)
    panel = box((-144 * t, -132 * t), (-44 * t, 44 * t), (22 * t, 0.68 * top - 14 * t), edge=3 * t)
    yield Piece(DARK, panel, BACK)


def link_1(d: ScaraDimensions) -> Iterator[Piece]:
    """The first arm: a slab with the bearings of both joints."""
    t = d.thickness
    low, high = (d.rise + 10 * t, 4 * t) if d.hangs else (-4 * t, d.rise + 26 * t)
    slab = casting(
        drum('z', (0, 0, 0), 54 * t, (low, high), edge=6 * t),
        drum('z', (d.arm_1, 0, 0), 45 * t, (low, high), edge=6 * t),
    )
    yield Piece(WHITE, _turned(slab, d.angle_1))
    top = (low - 1.0, low + 5.0) if d.hangs else (high - 5.0, high + 1.0)
    cap = drum('z', (d.arm_1, 0, 0), 38 * t, top, ends='none')
    yield Piece(DARK, _turned(cap, d.angle_1))


def link_2(d: ScaraDimensions) -> Iterator[Piece]:
    """The second arm: a slab that turns on the first, and the housing of motors and shaft."""
    t = d.thickness
    bottom, top = d.housing
    slab = (top - 40.0 * t, top) if d.hangs else (bottom, bottom + 40 * t)
    pivot = (top - 5.0, top + 14 * t) if d.hangs else (bottom - 10 * t, bottom + 5.0)
    yield Piece(DARK, _turned(drum('z', (0, 0, 0), 36 * t, pivot, ends='none'), d.angle_2))
    arm = casting(
        drum('z', (0, 0, 0), 44 * t, slab, edge=6 * t),
        drum('z', (d.arm_2, 0, 0), 34 * t, slab, edge=6 * t),
    )
    yield Piece(WHITE, _turned(arm, d.angle_2))
    middle = 0.35 * d.arm_2
    housing = casting(
        drum('z', (middle, 0, 0), 38 * t, (bottom + 4.0, top - 12 * t), edge=8 * t),
        drum('z', (d.arm_2, 0, 0), 30 * t, (bottom + 4.0, top), edge=8 * t),
    )
    yield Piece(WHITE, _turned(housing, d.angle_2), 1)
    lid = drum('z', (d.arm_2, 0, 0), 20 * t, (bottom, bottom + 6.0), ends='none')
    if not d.hangs:
        lid = drum('z', (d.arm_2, 0, 0), 20 * t, (top - 2.0, top + 2.0), ends='none')
    yield Piece(DARK, _turned(lid, d.angle_2), 1)


def link_3(d: ScaraDimensions) -> Iterator[Piece]:
    """The shaft that moves up and down: in the housing over its whole stroke."""
    t = d.thickness
    inside = d.housing[0] + 30.0 + d.stroke
    yield Piece(METAL, drum('z', (0, 0, 0), 8 * t, (24 * t, inside - d.drop), ends='none'))


def link_4(d: ScaraDimensions) -> Iterator[Piece]:
    """The end of the shaft, which turns: a collar, and where the tool is clamped."""
    t = d.thickness
    yield Piece(METAL, drum('z', (0, 0, 0), 7 * t, (0.0, 30 * t), edge=1.0, ends='low'))
    collar = drum('z', (0, 0, 0), 15 * t, (20 * t, 28 * t), edge=1.5)
    yield Piece(DARK, collar, 1)
    for head in bolts('z', (0, 0, 0), 11 * t, 4, 1.6 * t, (18.5 * t, 21 * t)):
        yield Piece(METAL, head, 1)


def _turned(solid: Solid, angle: float) -> Solid:
    return solid.rotate((0.0, 0.0, angle))


LINKS: dict[str, Callable[[ScaraDimensions], Iterator[Piece]]] = {
    'base_link': base_link,
    'link_1': link_1,
    'link_2': link_2,
    'link_3': link_3,
    'link_4': link_4,
}
