# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fractions of the joint limits that a plan's times require.

If a planner has been set to plan slowly (MoveIt's scaling factors), only the times of its plan
show this.
"""

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.trajectory import Trajectory

MIN_SHARE = 1e-3
"""Minimum fraction that `plan_share` returns, so that a tiny move does not lead to limits near 0.
"""

SPARSE_S = 0.25
"""Time between points above which divided differences are too far below the highest values, s."""

SPARSE_VELOCITY, SPARSE_ACCELERATION = 1.5, 3.0
"""Ratios of the highest values of a cubic from rest to rest to its divided differences."""


def plan_share(trajectory: Trajectory, start: Array, limits: JointLimits) -> tuple[float, float]:
    """Return the highest velocity and acceleration of a plan, as fractions of the limits, ≤ 1.

    `start`: position of the resting arm, shape (n,). The plan starts there if its first point has
    a time > 0.

    The highest joint counts. The values are those of the plan, and those that any motion needs to
    reach the points at their times (divided differences). Between points more than SPARSE_S apart,
    the higher values of a cubic count instead. Points that are not later than all previous points
    are ignored. A plan without times has the fractions 1 and 1.
    """
    times = trajectory.times
    later = times > np.maximum.accumulate(np.append(0.0, times[:-1]))
    if not later.any():
        return 1.0, 1.0
    first = trajectory.positions[:1] if times[0] <= 0.0 else start[None, :]
    times = np.append(0.0, times[later])
    positions = np.concatenate([first, trajectory.positions[later]])
    gaps = np.diff(times)[:, None]
    velocities = np.diff(positions, axis=0) / gaps
    spans = np.convolve(gaps[:, 0], [1.0, 1.0])[:, None]
    # the plan rests at both ends: these points count twice in the divided differences
    rest = np.zeros_like(first)
    changes = np.diff(velocities, axis=0, prepend=rest, append=rest)
    accelerations = 2.0 * changes / spans
    accelerations *= np.where(spans > SPARSE_S, SPARSE_ACCELERATION, 1.0)
    velocities *= np.where(gaps > SPARSE_S, SPARSE_VELOCITY, 1.0)
    share = []
    for values, given, limit in (
        (velocities, trajectory.velocities, limits.velocity),
        (accelerations, trajectory.accelerations, limits.acceleration),
    ):
        rows = values if given is None else np.concatenate([values, given])
        highest = float(np.nanmax(np.abs(rows) / limit))  # given values were not checked
        share.append(min(max(highest, MIN_SHARE), 1.0))
    return share[0], share[1]
