# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What ros2_control's joint_trajectory_controller does: one spline in time per joint and segment.

Cubic where the points carry velocities, quintic where they carry accelerations as well. It keeps
the time whatever the limits say. Plans without derivatives get them from finite differences here.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.interpolation import Interpolation, central_differences

SAMPLE_RATE_HZ = 1000.0
"""Samples per second; the jerk is the difference of their accelerations."""


@dataclass(frozen=True)
class SplineUse:
    """Time in s, and the largest velocity, acceleration and jerk as shares of the limits."""

    duration: float
    velocity: float
    acceleration: float
    jerk: float


def joint_spline(
    positions: Array, durations: Array, limits: JointLimits, quintic: bool
) -> SplineUse:
    """Return what the spline through points (n, joints), rad, demands; durations (n,), s."""
    knots = np.cumsum(durations)
    velocities = central_differences(knots, positions)
    accelerations = central_differences(knots, velocities) if quintic else None
    spline = Interpolation(knots, positions, velocities, accelerations)
    _, v, a = spline.at(np.arange(0.0, knots[-1], 1.0 / SAMPLE_RATE_HZ))
    jerk = np.diff(a, axis=0) * SAMPLE_RATE_HZ
    return SplineUse(
        float(knots[-1]),
        float(np.max(np.abs(v) / limits.velocity)),
        float(np.max(np.abs(a) / limits.acceleration)),
        float(np.max(np.abs(jerk) / limits.jerk)),
    )
