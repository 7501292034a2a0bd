# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A trajectory as the points that go over the wire."""

import numpy as np

from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.simple_message import JointTrajPt, SpecialSequence, joint_data

FIRST_VELOCITY = 0.1
"""Fraction of the maximum speed for a first point that has no time: ROS-Industrial's default."""

SHORTEST_DURATION = 1e-3
"""Controllers may refuse a duration of 0, s."""

STOP = JointTrajPt(SpecialSequence.STOP_TRAJECTORY)


def trajectory_points(
    trajectory: Trajectory, start: Array, limits: JointLimits
) -> list[JointTrajPt]:
    """Return the messages that stream a checked trajectory from `start` (shape (n,), rad).

    `velocity` is the largest fraction of a joint's limit that the plan uses in the segment, from
    its mean speed and the velocities at both ends: the arm is never asked to be faster than
    planned. `duration` is the segment's own time.
    """
    positions = to_float32_inside(trajectory.positions, limits)
    steps = np.diff(trajectory.positions, axis=0, prepend=start[None, :])
    durations = np.diff(trajectory.times, prepend=0.0)
    timed = np.maximum(durations, SHORTEST_DURATION)
    speeds = np.abs(steps) / timed[:, None]
    if trajectory.velocities is not None:
        ends = np.abs(trajectory.velocities)
        speeds = np.maximum(speeds, ends)
        speeds[1:] = np.maximum(speeds[1:], ends[:-1])
    fractions = np.max(speeds / limits.velocity, axis=1)
    if durations[0] == 0.0:
        fractions[0] = FIRST_VELOCITY
    fractions = np.clip(fractions, 1e-3, 1.0)
    return [
        JointTrajPt(sequence, joint_data(point), velocity, duration)
        for sequence, (point, velocity, duration) in enumerate(
            zip(positions.tolist(), fractions.tolist(), timed.tolist(), strict=True)
        )
    ]


def to_float32_inside(positions: Array, limits: JointLimits) -> Array:
    """Return positions as float32 numbers that are still within the position limits."""
    low = limits.position_min.astype(np.float32)
    low = np.where(low < limits.position_min, np.nextafter(low, np.float32(np.inf)), low)
    high = limits.position_max.astype(np.float32)
    high = np.where(high > limits.position_max, np.nextafter(high, np.float32(-np.inf)), high)
    return np.clip(positions.astype(np.float32), low, high).astype(np.float64)
