# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The scene as coloured triangles, for a picture."""

from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin

from epson_driver.motion import Array
from epson_driver.planning.scene import Scene
from epson_driver.planning.shapes import Box, Cylinder, Shape
from epson_driver.planning.workspace import TABLE
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.link_surfaces import link_surfaces

CYLINDER_SIDES = 36
"""Of what stands for a cylinder."""

Triangles = tuple[Array, Array]
"""Corners, shape (k, 3, 3), m, counter-clockwise seen from outside; colours, shape (k, 3)."""

COLOURS = {'table': (0.87, 0.86, 0.83), 'pillar': (0.80, 0.42, 0.28), 'tray': (0.55, 0.66, 0.75)}
PART_COLOUR, GRIPPER_COLOUR = (0.95, 0.72, 0.15), (0.25, 0.25, 0.28)


class Picture:
    """Triangles of one scene at any joint positions."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self._hand = scene, scene.workspace.hand
        self._kinematics = Kinematics(scene.robot)
        self._links = link_surfaces(scene.robot)

    def arm(self, joints: Array, *, holds: bool) -> Triangles:
        """Return the arm with its gripper, and with the part if it `holds` that."""
        frames = [np.eye(4), *self._kinematics.link_frames(joints)]
        found = [
            (
                _moved(surface.corners.astype(float), frame),
                np.tile(surface.colour, (len(surface.corners), 1)),
            )
            for frame, link in zip(frames, self._links, strict=True)
            for surface in link
        ]
        pose, length = self._scene.hand_pose(joints), self._hand.length
        corners = _cylinder(Cylinder('', self._hand.radius, length, (0.0, 0.0, length / 2)))
        found.append((_moved(corners, pose), np.tile(GRIPPER_COLOUR, (len(corners), 1))))
        if holds:
            found.append(self.part(pose))
        return joined(found)

    def part(self, pose: Array) -> Triangles:
        """Return the part where it is gripped by a hand at this pose, shape (4, 4)."""
        centre = (0.0, 0.0, self._hand.length + self._scene.part[2] / 2)
        corners = _moved(_box(Box('', self._scene.part, centre)), pose)
        return corners, np.tile(PART_COLOUR, (len(corners), 1))

    def obstacles(self) -> Triangles:
        """Return the obstacles on the table, and the arm's stand or gantry."""
        return joined(_shape(shape) for shape in self._scene.obstacles if shape.name != TABLE)

    def table(self) -> Triangles:
        """Return the table."""
        return joined(_shape(shape) for shape in self._scene.obstacles if shape.name == TABLE)


def joined(parts: Any) -> Triangles:
    """Return several sets of triangles as one."""
    corners, colours = zip(*parts, strict=True)
    return np.concatenate(corners), np.concatenate(colours)


def _shape(shape: Shape) -> Triangles:
    corners = _box(shape) if isinstance(shape, Box) else _cylinder(shape)
    colour = next((c for kind, c in COLOURS.items() if kind in shape.name), (0.6, 0.6, 0.6))
    return corners, np.tile(colour, (len(corners), 1))


def _moved(corners: Array, pose: Array) -> Array:
    return np.asarray(corners @ pose[:3, :3].T + pose[:3, 3])


def _box(box: Box) -> Array:
    half = np.array(box.size) / 2
    found = []
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        for sign in (1.0, -1.0):
            corners = np.empty((4, 3))
            corners[:, axis] = sign * half[axis]
            corners[:, one] = half[one] * np.array([-1.0, 1.0, 1.0, -1.0])
            corners[:, two] = sign * half[two] * np.array([-1.0, -1.0, 1.0, 1.0])
            found += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    turn = pin.utils.rotate('z', box.yaw)
    return np.asarray(np.array(found) @ turn.T + np.array(box.centre))


def _cylinder(cylinder: Cylinder) -> Array:
    angles = np.linspace(0.0, 2 * np.pi, CYLINDER_SIDES + 1)
    ring = cylinder.radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    half = cylinder.length / 2
    found = []
    for a, b in pairwise(ring):
        found += [
            [(*a, -half), (*b, -half), (*b, half)],
            [(*a, -half), (*b, half), (*a, half)],
            [(*a, half), (*b, half), (0.0, 0.0, half)],
            [(*b, -half), (*a, -half), (0.0, 0.0, -half)],
        ]
    return np.asarray(np.array(found) + np.array(cylinder.centre))
