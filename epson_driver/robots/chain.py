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
"""Joint type → SI unit of the joint's position."""

SHOWN_UNITS = {'rad': ('degrees', 180.0 / np.pi), 'm': ('mm', 1000.0)}
"""SI unit → unit in which EPSON shows a position, and the factor from the SI unit to it."""


@dataclass(frozen=True, eq=False)
class Chain:
    """Positions and axes of the n joints.

    * origins: origin of each joint in its parent's frame, shape (n, 3), m.
    * axes: unit vectors, shape (n, 3). When its position grows, a joint turns about its axis, or
      moves along it if prismatic.
    """

    origins: Array
    axes: Array


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame in its parent: xyz, shape (3,), m, and rpy, shape (3,), rad, about fixed axes."""

    xyz: Array
    rpy: Array

    @property
    def matrix(self) -> Array:
        """The frame as a homogeneous matrix, shape (4, 4)."""
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

    It is the largest distance of Tool 0 from the joint's axis for a revolute joint, m, and 1 for a
    prismatic one (m per m). `strokes`, shape (n,), m: the maximum distance of a prismatic joint
    from zero. `tool`, shape (3,), m: Tool 0 in the last link's frame. The result is an upper bound
    for all poses, whatever the ranges of revolute joints.

    The computation starts at the tool. A revolute joint turns the part of its offset that is
    perpendicular to its axis, which is an arm of fixed length. The part along the axis is passed
    on to the previous joint. The reach of a joint is the sum of the arms from it to the tool.
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
