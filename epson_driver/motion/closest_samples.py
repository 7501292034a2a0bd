# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Figures of a sampled motion: passages of waypoints, stops, usage of the limits."""

from dataclasses import dataclass
from math import ceil

import numpy as np
import numpy.typing as npt

from epson_driver.motion.interpolation import cubic
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.waypoints import MIN_DWELL_S
from epson_driver.motion.trajectory import Trajectory

MAX_COMPARED_PAIRS = 25_000_000
"""Maximum pairs of a waypoint and a sample compared together: 4 bytes each."""

Indices = npt.NDArray[np.intp]


def closest_sample_indices(waypoints: Array, positions: Array) -> Indices:
    """Return the sample that is nearest to each waypoint: (n, m) and (k, m) to (n,).

    The passages are in the waypoints' order and together the nearest possible (dynamic
    programming over waypoints and samples), so that a path may cross itself.
    """
    samples = np.arange(len(positions))
    came_from = np.empty((len(waypoints), len(samples)), dtype=np.int32)
    cost = np.zeros(len(samples))
    for index, waypoint in enumerate(waypoints):
        lowest = np.minimum.accumulate(cost)
        came_from[index] = np.maximum.accumulate(np.where(cost <= lowest, samples, 0))
        cost = lowest + np.abs(positions - waypoint).max(axis=1)
    passed = [int(np.argmin(cost))]
    for index in range(len(waypoints) - 1, 0, -1):
        passed.append(int(came_from[index, passed[-1]]))
    passed.reverse()
    return np.array(passed)


def passed(waypoints: Array, motion: Trajectory) -> tuple[Array, Array]:
    """Return a motion's distance from each waypoint, rad, and its time, s, shapes (n,).

    Between two samples the motion is the cubic with their positions and velocities. Raises
    ValueError for a motion without velocities.
    """
    if motion.velocities is None:
        raise ValueError('the motion has no velocities')
    samples = _sparing_passages(waypoints, motion.positions)
    errors = np.abs(motion.positions[samples] - waypoints).max(axis=1)
    times = motion.times[samples]
    for index, (waypoint, sample) in enumerate(zip(waypoints, samples.tolist(), strict=True)):
        for first in (sample - 1, sample):
            if 0 <= first < len(motion.times) - 1:
                error, time = _nearest(waypoint, motion, motion.velocities, first)
                if error < errors[index]:
                    errors[index], times[index] = error, time
    return errors, times


def _sparing_passages(waypoints: Array, positions: Array) -> Indices:
    """Return passages. For long motions, search every n-th sample first, then refine."""
    stride = ceil(len(waypoints) * len(positions) / MAX_COMPARED_PAIRS)
    result = closest_sample_indices(waypoints, positions[::stride]) * stride
    if stride == 1:
        return result
    for index, (waypoint, sample) in enumerate(zip(waypoints, result.tolist(), strict=True)):
        first = max(sample - stride, 0)
        near = positions[first : sample + stride + 1]
        result[index] = first + int(np.argmin(np.abs(near - waypoint).max(axis=1)))
    return result


def _nearest(
    waypoint: Array, motion: Trajectory, velocities: Array, first: int
) -> tuple[float, float]:
    """Return the smallest distance to a waypoint between two adjacent samples, and its time."""
    dt = float(motion.times[first + 1] - motion.times[first])
    start, end = ((motion.positions[i] - waypoint, velocities[i]) for i in (first, first + 1))
    low, high = 0.0, 1.0
    for _ in range(3):  # each time between the neighbours of the best of 41 places
        s = np.linspace(low, high, 41)
        distances = np.abs(cubic(s[:, None], dt, start, end)).max(axis=1)
        best = int(np.argmin(distances))
        low, high = float(s[max(best - 1, 0)]), float(s[min(best + 1, 40)])
    return float(distances[best]), float(motion.times[first] + s[best] * dt)


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
    times. Raises ValueError if the motion has no velocities or accelerations.
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
