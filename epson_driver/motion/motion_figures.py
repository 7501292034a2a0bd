# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Figures of a sampled motion: its duration, its stops, and its usage of the limits."""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.waypoints import MIN_DWELL_S
from epson_driver.motion.trajectory import Trajectory

REST_VELOCITY_SHARE = 1e-3
"""Share of its velocity limit below which a joint is at rest."""

TURNING_ACCELERATION_SHARE = 0.05
"""Share of its acceleration limit above which a joint without speed reverses and does not stop."""

RESTING_COMMAND_SHARE = 2e-3
"""Share of the velocity limit up to which a command counts as no motion."""


@dataclass(frozen=True)
class Figures:
    """Figures of a motion: s, and velocity … jerk as the largest multiple of a joint's limit.

    stops: stops between start and end, without the commanded ones. jerk: from the change of the
    acceleration between two samples.
    """

    duration: float
    stops: int
    commanded_stops: int
    velocity: float
    acceleration: float
    jerk: float


def measure(motion: Trajectory, command: Trajectory | None, limits: JointLimits) -> Figures:
    """Return the figures of a motion with velocities and accelerations, equally spaced.

    `command`: the plan, which may command rests between start and end, or None to ignore its
    times. Raises ValueError for a motion without velocities or accelerations.
    """
    if motion.velocities is None or motion.accelerations is None:
        raise ValueError('the motion has no velocities or no accelerations')
    speed = np.max(np.abs(motion.velocities) / limits.velocity, axis=1)
    push = np.max(np.abs(motion.accelerations) / limits.acceleration, axis=1)
    jerks = np.diff(motion.accelerations, axis=0) / np.diff(motion.times)[:, None]
    rests = 0 if command is None else commanded_rests(command, limits)
    stops = _stops(speed, push)
    return Figures(
        motion.duration - float(motion.times[0]),
        max(stops - rests, 0),
        min(stops, rests),
        float(speed.max()),
        float(push.max()),
        float(np.max(np.abs(jerks) / limits.jerk, initial=0.0)),
    )


def _stops(speed: Array, push: Array) -> int:
    """Return the number of stops of at least two samples between start and end."""
    still = (speed < REST_VELOCITY_SHARE) & (push < TURNING_ACCELERATION_SHARE)
    moving = np.flatnonzero(speed >= REST_VELOCITY_SHARE)
    if not moving.size:
        return 0
    inside = still[moving[0] : moving[-1]].astype(np.int8)
    edges = np.diff(inside, prepend=0, append=0)
    return int(np.sum(np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1) >= 2))


def commanded_rests(command: Trajectory, limits: JointLimits) -> int:
    """Return the number of rests that a timed plan commands between start and end."""
    durations = np.diff(command.times)
    ways = np.max(np.abs(np.diff(command.positions, axis=0)) / limits.velocity, axis=1)
    resting = ways <= RESTING_COMMAND_SHARE * durations
    moving = np.flatnonzero(~resting)
    if not moving.size:
        return 0
    inside = slice(moving[0], moving[-1])
    edges = np.diff(resting[inside].astype(np.int8), prepend=0, append=0)
    elapsed = np.concatenate([[0.0], np.cumsum(durations[inside])])
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return int(np.sum(elapsed[ends] - elapsed[begins] >= MIN_DWELL_S))
