# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The chain of joints and the fixed frames at its two ends, as data.

At the zero pose the frames of all joints and links are parallel to base_link, which follows
REP-103: x forward, y left, z up.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array

REVOLUTE, PRISMATIC = JOINT_TYPES = ('revolute', 'prismatic')

UNITS = {REVOLUTE: 'rad', PRISMATIC: 'm'}

SHOWN_UNITS = {'rad': ('degrees', 180.0 / np.pi), 'm': ('mm', 1000.0)}
"""SI unit → EPSON's unit, and the factor for the conversion to it."""


@dataclass(frozen=True, eq=False)
class Chain:
    """The n joints of an arm: their origins in their parents' frames, m, and their axes.

    Both have the shape (n, 3). The axes are unit vectors. When its position increases, a revolute
    joint turns about its axis (right-hand rule), and a prismatic joint moves along its axis.
    """

    origins: Array
    axes: Array


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame, given in its parent frame.

    `xyz` has the shape (3,), m, and `rpy`, shape (3,), rad, contains rotations about fixed axes.
    """

    xyz: Array
    rpy: Array

    @property
    def matrix(self) -> Array:
        matrix = np.eye(4)
        x, y, z = np.eye(3)
        roll, pitch, yaw = self.rpy
        matrix[:3, :3] = (
            rotation_about(z, yaw) @ rotation_about(y, pitch) @ rotation_about(x, roll)
        )
        matrix[:3, 3] = self.xyz
        return matrix


def rotation_about(axis: Array, angle: float) -> Array:
    """Return the rotation by `angle`, rad, about a unit axis, shape (3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # computing 1 - cos from half the angle keeps all digits for a small angle
    versed = 2.0 * np.sin(angle / 2.0) ** 2
    return np.asarray(np.eye(3) + np.sin(angle) * cross + versed * cross @ cross)


def reach(chain: Chain, types: tuple[str, ...], strokes: Array, tool: Array) -> Array:
    """Return the maximum distance that the tool moves per unit of each joint, shape (n,).

    It is an upper bound for all poses, regardless of the ranges of revolute joints. `strokes`:
    maximum distance of prismatic joints from zero, m. `tool`: position of Tool 0 in the last
    link's frame, m.

    The computation starts at the tool. A revolute joint turns the part of its offset that is
    perpendicular to its axis. This part is a lever of fixed length. The part along the axis is
    passed to the previous joint. A joint's reach is the sum of the levers between this joint and
    the tool.
    """
    count = len(types)
    arms = np.zeros(count)
    hanging = [tool]  # a fixed vector, then one for each stroke
    for joint in reversed(range(count)):
        axis = chain.axes[joint]
        if types[joint] == PRISMATIC:
            hanging.append(axis * strokes[joint])
        else:
            along = [axis * (axis @ vector) for vector in hanging]
            arms[joint] = sum(
                float(np.linalg.norm(vector - part))
                for vector, part in zip(hanging, along, strict=True)
            )
            hanging = along
        hanging[0] = hanging[0] + chain.origins[joint]
    beyond = np.cumsum(arms[::-1])[::-1]
    return np.where([kind == PRISMATIC for kind in types], 1.0, beyond)
