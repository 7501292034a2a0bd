# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the smoother is held against: from rest to rest at every point, and splines in time."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array, JointLimits, Trajectory, go
from epson_driver.motion.interpolation import Interpolation, central_differences
from epson_driver.motion.smoothed import every, smoothed


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


def in_time(degree: int, knots: Array, positions: Array, limits: JointLimits) -> Trajectory:
    """Return points with velocities, and with accelerations too if the degree is 5."""
    velocities = central_differences(knots, positions)
    accelerations = central_differences(knots, velocities) if degree == QUINTIC else None
    return Trajectory(limits.names, knots, positions, velocities, accelerations)


def handed_on(knots: Array, positions: Array, limits: JointLimits) -> Trajectory:
    """Return the points that smooth_goals hands on instead, 8 ms apart."""
    plan = Trajectory(limits.names, knots, positions)
    return every(smoothed(plan, limits, refine=False), 2)


QUINTIC = 5
SPLINES: dict[str, Callable[[Array, Array, JointLimits], Trajectory]] = {
    'cubic': partial(in_time, 3),
    'quintic': partial(in_time, QUINTIC),
    'quintic, behind smooth_goals': handed_on,
}
"""What ros2_control's joint_trajectory_controller is sent, of points (n, joints), at times."""


def joint_spline(name: str, positions: Array, durations: Array, limits: JointLimits) -> SplineUse:
    """Return what one of SPLINES demands of points (n, joints), rad; durations (n,), s.

    As joint_trajectory_controller: cubic between points with velocities, quintic with
    accelerations; it keeps the time whatever the limits say.
    """
    sent = SPLINES[name](np.cumsum(durations), positions, limits)
    spline = Interpolation(sent.times, sent.positions, sent.velocities, sent.accelerations)
    _, v, a = spline.at(np.arange(0.0, sent.duration, 1.0 / SAMPLE_RATE_HZ))
    jerk = np.diff(a, axis=0) * SAMPLE_RATE_HZ
    return SplineUse(
        sent.duration,
        float(np.max(np.abs(v) / limits.velocity)),
        float(np.max(np.abs(a) / limits.acceleration)),
        float(np.max(np.abs(jerk) / limits.jerk)),
    )
