# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How near an arm is to a singularity: the condition of its Jacobian, m and rad as MoveIt has it.

That number grows with a small arm's rotations and falls with a large one's: which is usual, and
which is near, is a question of the model.
"""

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.chain import PRISMATIC
from epson_driver.robots.model import RobotModel

POSES = 2000
"""So many poses, drawn over the ranges of the joints, stand for all that the arm can take."""

USUAL, NEARLY_ALL = 0.8, 0.95
"""Shares of them: beyond the condition of the first an arm is slowed, beyond the second halted."""


def singularity_thresholds(model: RobotModel) -> tuple[float, float]:
    """Return the conditions beyond which MoveIt Servo slows the arm, and halts it."""
    limits = model.limits
    random = np.random.default_rng(0)
    shape = (POSES, len(limits.names))
    found = conditions(model, random.uniform(limits.position_min, limits.position_max, shape))
    lower, stop = np.quantile(found, (USUAL, NEARLY_ALL))
    return float(lower), float(stop)


def conditions(model: RobotModel, joints: Array) -> Array:
    """Return the condition of tool0's Jacobian, shape (k,), at joints of shape (k, n), rad or m.

    The largest singular value by the smallest one; inf where a direction is lost.
    """
    chain, count = model.chain, len(joints)
    turns = np.broadcast_to(np.eye(3), (count, 3, 3))
    place = np.zeros((count, 3))
    axes, places = [], []
    rows = zip(chain.origins, chain.axes, model.joint_types, joints.T, strict=True)
    for origin, (x, y, z), kind, values in rows:
        place = place + turns @ origin
        axes.append(turns @ np.array([x, y, z]))
        places.append(place)
        if kind == PRISMATIC:
            place = place + axes[-1] * values[:, None]
            continue
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        sine, versed = np.sin(values), 1.0 - np.cos(values)
        turn = np.eye(3) + sine[:, None, None] * cross + versed[:, None, None] * (cross @ cross)
        turns = turns @ turn
    tool = place + turns @ model.tool0.xyz
    columns = [
        np.hstack([axis, np.zeros_like(axis)])
        if kind == PRISMATIC
        else np.hstack([np.cross(axis, tool - at), axis])
        for axis, at, kind in zip(axes, places, model.joint_types, strict=True)
    ]
    values = np.linalg.svd(np.stack(columns, axis=2), compute_uv=False)
    with np.errstate(divide='ignore'):
        return np.asarray(values[:, 0] / values[:, -1])
