# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Baselines for the smoother: motion that rests at every point, and splines in time."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from epson_driver.motion import Array, JointLimits, Trajectory, go
from epson_driver.motion.interpolation import central_differences
from epson_driver.node.stoppable import StoppableMotion
from epson_driver.report.smooth_study import Figures, measure, spline


@dataclass(frozen=True)
class StopAndGo:
    """Total duration of the moves, s, and the number of stops at points between the ends."""

    duration: float
    stops: int


def stop_and_go(positions: Array, limits: JointLimits) -> StopAndGo:
    """Return the time through the points (n, joints), rad. A repeated point takes no time."""
    moves = [go(limits, start, target).duration for start, target in pairwise(positions)]
    return StopAndGo(float(np.sum(moves)), max(sum(move > 0.0 for move in moves) - 1, 0))


def quintic(plan: Trajectory, _: JointLimits) -> Trajectory:
    """Return a plan with velocities and accelerations from finite differences."""
    velocities = central_differences(plan.times, plan.positions)
    accelerations = central_differences(plan.times, velocities)
    return replace(plan, velocities=velocities, accelerations=accelerations)


def handed_on(plan: Trajectory, limits: JointLimits) -> Trajectory:
    """Return the plan as sent by smooth_goals, with points at most 8 ms apart."""
    return StoppableMotion(plan, limits).points(0.008)


SPLINES: dict[str, Callable[[Trajectory, JointLimits], Trajectory]] = {
    'cubic': lambda plan, _: plan,
    'quintic': quintic,
    'quintic, behind smooth_goals': handed_on,
}
"""Preparations of a plan's positions and times for ros2_control's joint_trajectory_controller."""


def joint_spline(name: str, positions: Array, durations: Array, limits: JointLimits) -> Figures:
    """Return the demands of one of SPLINES for points (n, joints), rad, and durations (n,), s.

    Like joint_trajectory_controller, it keeps the times regardless of the limits.
    """
    plan = Trajectory(limits.names, np.cumsum(durations), positions)
    sampled, _ = spline(SPLINES[name](plan, limits))
    return measure(sampled, None, limits)
