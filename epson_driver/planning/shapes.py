# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Obstacles around the arm: boxes and upright cylinders in base_link, m."""

from dataclasses import dataclass, replace
from math import cos, sin


@dataclass(frozen=True)
class Box:
    """A box along the axes of base_link, but turned by `yaw`, rad, about its own z."""

    name: str
    size: tuple[float, float, float]
    centre: tuple[float, float, float]
    yaw: float = 0.0


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder."""

    name: str
    radius: float
    length: float
    centre: tuple[float, float, float]


Shape = Box | Cylinder


def lifted(shape: Shape, height: float) -> Shape:
    """Return the shape raised by `height`, m."""
    x, y, z = shape.centre
    return replace(shape, centre=(x, y, z + height))


def standing(name: str, size: tuple[float, float, float], x: float, y: float) -> Box:
    """Return a box that stands on the table."""
    return Box(name, size, (x, y, size[2] / 2))


def tray(
    name: str, inside: float, height: float, wall: float, x: float, y: float, yaw: float
) -> tuple[Box, ...]:
    """Return an open tray on the table: its floor, then four walls.

    `inside`: the length of its square floor; `wall`: thickness of floor and walls.
    """
    outside = inside + 2 * wall
    middle = (inside + wall) / 2
    sides = (
        (middle, 0.0, (wall, outside, height)),
        (-middle, 0.0, (wall, outside, height)),
        (0.0, middle, (inside, wall, height)),
        (0.0, -middle, (inside, wall, height)),
    )
    floor = Box(f'{name} floor', (inside, inside, wall), (x, y, wall / 2), yaw)
    walls = (
        Box(
            f'{name} wall {number}',
            size,
            (x + cos(yaw) * dx - sin(yaw) * dy, y + sin(yaw) * dx + cos(yaw) * dy, height / 2),
            yaw,
        )
        for number, (dx, dy, size) in enumerate(sides, start=1)
    )
    return (floor, *walls)
