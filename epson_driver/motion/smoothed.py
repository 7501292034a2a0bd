# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A whole trajectory through the smoother, and the figures of a motion, from its samples."""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import numpy as np
import numpy.typing as npt

from epson_driver.motion.interpolation import cubic
from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother import MERGE_TOLERANCE, Mode, Plan, Request, Smoother, plan
from epson_driver.motion.smoother.waypoints import MIN_DWELL_S
from epson_driver.motion.trajectory import Trajectory

LONGEST_STEP = 0.004
"""The smoother is stepped at least so often, s: it plans between two steps."""

AT_REST = 1e-3
"""Share of its velocity limit below which a joint stands."""

TURNING = 0.05
"""Share of its acceleration limit above which a joint without speed turns round: no stop."""

RESTING = 2e-3
"""Share of the velocity limit up to which a command asks for no motion."""

MOST = 25_000_000
"""Pairs of a waypoint and a sample that are looked at together: 4 bytes each."""

Indices = npt.NDArray[np.intp]


def smoothed(
    trajectory: Trajectory,
    limits: JointLimits,
    mode: Mode = Mode.TIME_PRESERVING,
    look_ahead: float = np.inf,
    period: float = LONGEST_STEP,
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
    steps = ceil(period / LONGEST_STEP - 1e-9)
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


@dataclass(frozen=True)
class Figures:
    """A motion in numbers: s, and velocity … jerk as the largest multiple of a joint's limit.

    stops: on the way, without those that were commanded. jerk: from the change of the
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

    `command`: the plan that may ask for rests on the way; None if its times do not count.
    Raises ValueError for a motion without velocities or accelerations.
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
    """Return how often an arm stood still, for two samples or more, between start and end."""
    still = (speed < AT_REST) & (push < TURNING)
    moving = np.flatnonzero(speed >= AT_REST)
    if not moving.size:
        return 0
    inside = still[moving[0] : moving[-1]].astype(np.int8)
    edges = np.diff(inside, prepend=0, append=0)
    return int(np.sum(np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1) >= 2))


def commanded_rests(command: Trajectory, limits: JointLimits) -> int:
    """Return how often a timed plan asks the arm to stand for a while between start and end."""
    durations = np.diff(command.times)
    ways = np.max(np.abs(np.diff(command.positions, axis=0)) / limits.velocity, axis=1)
    resting = ways <= RESTING * durations
    moving = np.flatnonzero(~resting)
    if not moving.size:
        return 0
    inside = slice(moving[0], moving[-1])
    edges = np.diff(resting[inside].astype(np.int8), prepend=0, append=0)
    elapsed = np.concatenate([[0.0], np.cumsum(durations[inside])])
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return int(np.sum(elapsed[ends] - elapsed[begins] >= MIN_DWELL_S))


def passages(waypoints: Array, positions: Array) -> Indices:
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
    """Return how far from each waypoint a motion passes, rad, and when, s; shapes (n,).

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
    """Return passages; of long motions first among some of the samples, then near by."""
    stride = ceil(len(waypoints) * len(positions) / MOST)
    found = passages(waypoints, positions[::stride]) * stride
    if stride == 1:
        return found
    for index, (waypoint, sample) in enumerate(zip(waypoints, found.tolist(), strict=True)):
        first = max(sample - stride, 0)
        near = positions[first : sample + stride + 1]
        found[index] = first + int(np.argmin(np.abs(near - waypoint).max(axis=1)))
    return found


def _nearest(
    waypoint: Array, motion: Trajectory, velocities: Array, first: int
) -> tuple[float, float]:
    """Return how near a motion comes to a waypoint between a sample and the next, and when."""
    dt = float(motion.times[first + 1] - motion.times[first])
    begin, end = ((motion.positions[i] - waypoint, velocities[i]) for i in (first, first + 1))
    low, high = 0.0, 1.0
    for _ in range(3):  # each time between the neighbours of the nearest of 41 places
        s = np.linspace(low, high, 41)
        distances = np.abs(cubic(s[:, None], dt, begin, end)).max(axis=1)
        best = int(np.argmin(distances))
        low, high = float(s[max(best - 1, 0)]), float(s[min(best + 1, 40)])
    return float(distances[best]), float(motion.times[first] + s[best] * dt)


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
