# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A whole trajectory through the smoother at once."""

from collections.abc import Callable
from math import ceil

import numpy as np

from epson_driver.motion.limits import JointLimits
from epson_driver.motion.passages import passed
from epson_driver.motion.smoother import MERGE_TOLERANCE, Mode, Plan, Request, Smoother, plan
from epson_driver.motion.trajectory import Trajectory

MAX_STEP_S = 0.004
"""The smoother is stepped at least so often, s: it plans between two steps."""


def smoothed(
    trajectory: Trajectory,
    limits: JointLimits,
    mode: Mode = Mode.TIME_PRESERVING,
    look_ahead: float = np.inf,
    period: float = MAX_STEP_S,
    planner: Callable[[Request, JointLimits], Plan | None] = plan,
) -> Trajectory:
    """Return the smooth motion through a trajectory's points, one point every `period` s.

    It begins and ends at rest, at the first and the last point. Its joints are in the order of
    the limits. The smoother is given points as long as less than `look_ahead` s are known to it.
    TIME_OPTIMAL takes the positions only. Raises ValueError that names point, joint, value and
    limit for a trajectory that cannot be smoothed, or if its motion would break a limit;
    RuntimeError if the planner raises.
    """
    if not period > 0.0:
        raise ValueError(f'period = {period} s: must be positive')
    if not look_ahead > 0.0:
        raise ValueError(f'look_ahead = {look_ahead} s: must be positive')
    trajectory = trajectory.in_order(limits.names)
    positions, times = trajectory.positions, trajectory.times
    durations = np.diff(times, prepend=times[0]).tolist()
    smoother = Smoother(limits, positions[0], mode, planner=planner)
    steps = ceil(period / MAX_STEP_S - 1e-9)
    motion = smoother.motion
    samples = [motion]
    fed = 0
    while fed < len(positions) or smoother.moving:
        for _ in range(steps):
            while fed < len(positions) and smoother.look_ahead < look_ahead:
                smoother.append(positions[fed], durations[fed])
                fed += 1
                if fed == len(positions):
                    smoother.finish()
            motion = smoother.step(period / steps)
            if smoother.violation is not None:
                raise ValueError(f'the smooth motion breaks a limit: {smoother.violation}')
            if smoother.planner_error is not None:
                raise RuntimeError('the planner failed') from smoother.planner_error
        samples.append(motion)
    position, velocity, acceleration = (np.array(column) for column in zip(*samples, strict=True))
    offset = 0.0 if mode is Mode.TIME_OPTIMAL else float(times[0])
    return Trajectory(
        limits.names,
        np.asarray(offset + period * np.arange(len(samples))),
        position,
        velocity,
        acceleration,
    )


def retimed(trajectory: Trajectory, limits: JointLimits) -> Trajectory:
    """Return a trajectory's own points at the times of the time-optimal motion through them.

    With the velocities there; points that repeat the one before are left out. Raises as
    `smoothed`.
    """
    motion = smoothed(trajectory, limits, Mode.TIME_OPTIMAL)
    positions = trajectory.in_order(limits.names).positions
    apart = np.abs(np.diff(positions, axis=0)).max(axis=1) >= MERGE_TOLERANCE
    kept = np.concatenate([np.flatnonzero(apart), [len(positions) - 1]])  # the last of each run
    positions = positions[kept]
    _, times = passed(positions, motion)
    times[0], times[-1] = 0.0, motion.duration
    forward = np.concatenate([[True], times[1:] > np.maximum.accumulate(times)[:-1]])
    forward[-1] = True
    times, positions = times[forward], positions[forward]
    assert motion.velocities is not None  # noqa: S101 - for the type checker
    velocities = np.stack(
        [np.interp(times, motion.times, column) for column in motion.velocities.T], axis=1
    )
    return Trajectory(limits.names, times, positions, velocities)
