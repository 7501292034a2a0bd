# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Details of a planned motion for a statement: a point on a circle, and the tool."""

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.kinematics import Kinematics, uvw

SAME_M = 1e-6
"""Tool motion below which the tool only turns, m."""

MAX_LOOKS = 2000


def passing(arm: Kinematics, positions: Array, via: Array) -> Array:
    """Return joints, shape (n,), with the tool at `via`, shape (3,), m, on a planned path.

    positions: shape (k, n), rad (m), points of that path. The tool's orientation is that of the
    nearest point.
    """
    positions = positions[:: len(positions) // MAX_LOOKS + 1]
    poses = [arm.forward(row) for row in positions]
    nearest = int(np.argmin([np.linalg.norm(pose[:3, 3] - via) for pose in poses]))
    pose = poses[nearest].copy()
    pose[:3, 3] = via
    found = arm.inverse(pose, positions[nearest])
    return np.asarray(found[0] if len(found) else positions[nearest])


def only_turns(arm: Kinematics, start: Array, end: Array) -> bool:
    """Return whether the tool has the same position with the joints `start` and `end`, (n,)."""
    way = arm.forward(end)[:3, 3] - arm.forward(start)[:3, 3]
    return bool(np.linalg.norm(way) < SAME_M)


def tool_frame(pose: Array) -> tuple[float, float, float, float, float, float] | None:
    """Return a tool in the flange, shape (4, 4), m, as x y z in mm and u v w in degrees.

    None: the tool is the flange.
    """
    if np.allclose(pose, np.eye(4), atol=1e-9):
        return None
    x, y, z = (pose[:3, 3] * 1e3).tolist()
    u, v, w = np.degrees(uvw(pose[:3, :3])).tolist()
    return x, y, z, u, v, w
