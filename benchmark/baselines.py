# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the smoother is held against: from rest to rest at every point, and splines in time."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array, JointLimits, Trajectory, go
from epson_driver.motion.interpolation import central_differences
from epson_driver.motion.motion_figures import Figures, measure
from epson_driver.motion.stoppable import StoppableMotion
from epson_driver.report.smooth_study import spline


@dataclass(frozen=True)
class StopAndGo:
    """Sum of the moves' durations, s, and how many points between the ends it stops at."""

    duration: float
    stops: int


def stop_and_go(positions: Array, limits: JointLimits) -> StopAndGo:
    """Return the time through the points (n, joints), rad; a repeated point takes none."""
    moves = [go(limits, start, target).duration for start, target in pairwise(positions)]
    return StopAndGo(float(np.sum(moves)), max(sum(move > 0.0 for move in moves) - 1, 0))


def quintic(plan: Trajectory, _: JointLimits) -> Trajectory:
    """Return a plan with velocities and accelerations, from differences."""
    velocities = central_differences(plan.times, plan.positions)
    accelerations = central_differences(plan.times, velocities)
    return replace(plan, velocities=velocities, accelerations=accelerations)


def handed_on(plan: Trajectory, limits: JointLimits) -> Trajectory:
    """Return what smooth_goals hands on instead, points at most 8 ms apart."""
    return StoppableMotion(plan, limits).points(0.008)


SPLINES: dict[str, Callable[[Trajectory, JointLimits], Trajectory]] = {
    'cubic': lambda plan, _: plan,
    'quintic': quintic,
    'quintic, behind smooth_goals': handed_on,
}
"""What ros2_control's joint_trajectory_controller is sent of a plan's positions and times."""


def joint_spline(name: str, positions: Array, durations: Array, limits: JointLimits) -> Figures:
    """Return what one of SPLINES demands of points (n, joints), rad; durations (n,), s.

    As joint_trajectory_controller has it, which keeps the time whatever the limits say.
    """
    plan = Trajectory(limits.names, np.cumsum(durations), positions)
    sampled, _ = spline(SPLINES[name](plan, limits))
    return measure(sampled, None, limits)
