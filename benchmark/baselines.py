# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the smoother is held against: from rest to rest at every point, and splines in time."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array, JointLimits, go
from epson_driver.motion.interpolation import Interpolation, central_differences


@dataclass(frozen=True)
class StopAndGo:
    """Sum of the moves' durations, s, and how many points between the ends it stops at."""

    duration: float
    stops: int


def stop_and_go(positions: Array, limits: JointLimits) -> StopAndGo:
    """Return the time through the points (n, joints), rad; a repeated point takes none."""
    moves = [go(limits, start, target).duration for start, target in pairwise(positions)]
    return StopAndGo(float(np.sum(moves)), max(sum(move > 0.0 for move in moves) - 1, 0))


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
    """Return what the spline through points (n, joints), rad, demands; durations (n,), s.

    As ros2_control's joint_trajectory_controller: cubic where points carry velocities, quintic
    with accelerations; it keeps the time whatever the limits say.
    """
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
