# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A plan of two joints, and motions that are sampled from a known function."""

import numpy as np

from epson_driver.motion import JointLimits, Trajectory

NAMES = ('a', 'b')
LIMITS = JointLimits(
    NAMES,
    np.full(2, -3.0),
    np.full(2, 3.0),
    np.array([8.0, 4.0]),
    np.array([50.0, 40.0]),
    np.array([500.0, 400.0]),
)
SHARE = np.linspace(0.0, 1.0, 12)[:, None]
CURVE = np.hstack([2.0 * SHARE - 1.0, np.sin(4.0 * SHARE)])
PLAN = Trajectory(NAMES, np.linspace(0.0, 2.2, 12), CURVE)


def motion_of(times, position):
    """Return a motion of joint a alone, from a function of time."""
    q = position(times)
    v = np.gradient(q, times)
    columns = [np.stack([each, 0.0 * each], axis=1) for each in (q, v, np.gradient(v, times))]
    return Trajectory(NAMES, times, *columns)
