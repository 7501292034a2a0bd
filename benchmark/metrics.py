# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Metrics of a sampled motion, computed from its samples alone."""

from dataclasses import dataclass

import numpy as np

from benchmark.trajectories import BenchmarkTrajectory
from benchmark.waypoints import Mask, Record, may_be_merged, waypoint_passages
from epson_driver.motion import Array, JointLimits

MERGE_TOLERANCE_RAD = 5e-4
"""Maximum distance of the path from a waypoint that is this close to another one, rad."""
ARRIVED_DISTANCE_RAD = 1e-6
"""Distance from its last position within which a motion counts as over, rad."""
REST_VELOCITY_SHARE = 1e-4
"""Share of the velocity limit below which a joint is at rest. The arm is if all joints are."""
TURNING_ACCELERATION_SHARE = 0.05
"""Share of the acceleration limit above which an arm without speed is reversing instead of
stopping."""
STEADY_ACCELERATION_RATIO = 0.6
"""An arm is also reversing if its acceleration stays above this share of its maximum during the
samples without speed and their neighbours. At a stop it is 0."""
MIN_STOP_SAMPLES = 2
MIN_COMMANDED_REST_S = 0.2
"""Duration from which a command without motion is a commanded stop, s."""
REST_TOLERANCE_S = 0.1
"""Tolerance in time between a stop and a commanded rest, s."""
RESTING_COMMAND_SHARE = 2e-3
"""Share of the velocity limit below which a command requests no motion."""


@dataclass(frozen=True)
class Metrics:
    """Metrics of one motion. Times in s, angles in rad, velocity … jerk as shares of the limits.

    waypoint: maximum distance from a waypoint, or its excess over the merge tolerance for points
    that may be merged. early: maximum time by which a point is passed too early. overrun: maximum
    distance from the last point after reaching it. mismatch: largest inconsistency of velocities
    and accelerations with the changes of position, as a share of the limit.
    """

    duration: float
    velocity: float
    acceleration: float
    jerk: float
    mismatch: float
    stops: int
    waypoint: float
    early: float
    overrun: float
    end: float
    outside: float
    step_p99: float


def measure(
    trajectory: BenchmarkTrajectory, record: Record, limits: JointLimits, timed: bool
) -> Metrics:
    """Return the metrics of a motion along a trajectory. `timed`: it had to keep the times."""
    positions = record.positions
    last = trajectory.positions[-1]
    passed = waypoint_passages(trajectory.positions, record)
    merged = may_be_merged(trajectory.positions, MERGE_TOLERANCE_RAD)
    errors = np.where(
        merged, np.maximum(passed.distances - MERGE_TOLERANCE_RAD, 0.0), passed.distances
    )
    return Metrics(
        duration=_duration(record),
        velocity=_use(record.velocities, limits.velocity),
        acceleration=_use(record.accelerations, limits.acceleration),
        jerk=_use(np.diff(record.accelerations, axis=0) / record.dt, limits.jerk),
        mismatch=_mismatch(record, limits),
        stops=_stops(trajectory, record, limits, passed.times, timed),
        waypoint=float(errors.max()),
        early=_early(trajectory, passed.times[~merged], ~merged) if timed else 0.0,
        overrun=_overrun(positions, last, int(passed.times[-1] / record.dt)),
        end=float(np.max(np.abs(positions[-1] - last))),
        outside=_outside(positions, limits),
        step_p99=_step_cost(record),
    )


def _use(values: Array, limit: Array) -> float:
    return float(np.max(np.abs(values) / limit)) if len(values) else 0.0


def _duration(record: Record) -> float:
    """Return the time from which the motion is over: close to its end, and at rest."""
    away = np.max(np.abs(record.positions - record.positions[-1]), axis=1) > ARRIVED_DISTANCE_RAD
    moving = np.flatnonzero(away)
    return record.dt * float(moving[-1] + 1) if moving.size else 0.0


def _mismatch(record: Record, limits: JointLimits) -> float:
    """Compare velocities and accelerations with the changes of position.

    Over a step, position changes by the mean velocity (less a term of the accelerations), and
    velocity by the mean acceleration. This is exact for constant jerk.
    """
    dt, v, a = record.dt, record.velocities, record.accelerations
    moved = dt * (v[1:] + v[:-1]) / 2.0 - dt**2 * (a[1:] - a[:-1]) / 12.0
    of_v = _use((np.diff(record.positions, axis=0) - moved) / dt, limits.velocity)
    of_a = _use(np.diff(v, axis=0) / dt - (a[1:] + a[:-1]) / 2.0, limits.acceleration)
    return max(of_v, of_a)


def _stops(
    trajectory: BenchmarkTrajectory,
    record: Record,
    limits: JointLimits,
    passed: Array,
    timed: bool,
) -> int:
    """Count stops before the end that were not commanded."""
    rests = commanded_rests(trajectory, limits) if timed else []
    times = [
        (passed[first] - REST_TOLERANCE_S, passed[last] + REST_TOLERANCE_S)
        for first, last in rests
    ]
    made = [(record.dt * first, record.dt * last) for first, last in stops(record, limits)]
    return sum(
        not any(start <= last and first <= end for start, end in times) for first, last in made
    )


def stops(record: Record, limits: JointLimits) -> list[tuple[int, int]]:
    """Return first and last sample of every stop strictly between start and end."""
    speed = np.max(np.abs(record.velocities) / limits.velocity, axis=1)
    push = np.max(np.abs(record.accelerations) / limits.acceleration, axis=1)
    slow = speed < REST_VELOCITY_SHARE
    still = slow & (push < TURNING_ACCELERATION_SHARE)
    moving = np.flatnonzero(~slow)
    if not moving.size:
        return []
    still[: moving[0]] = still[moving[-1] :] = False
    edges = np.diff(still.astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [
        (int(start), int(end))
        for start, end in zip(begins, ends, strict=True)
        if end - start + 1 >= MIN_STOP_SAMPLES and not _turns(push[start - 1 : end + 2])
    ]


def _turns(push: Array) -> bool:
    """Return whether the arm is reversing, from its acceleration while it has no speed."""
    return bool(push.min() > STEADY_ACCELERATION_RATIO * push.max())


def commanded_rests(trajectory: BenchmarkTrajectory, limits: JointLimits) -> list[tuple[int, int]]:
    """Return the index ranges of points, first and last, in which no motion is commanded."""
    if trajectory.durations is None:
        return []
    steps = np.max(np.abs(np.diff(trajectory.positions, axis=0)) / limits.velocity, axis=1)
    resting = steps <= RESTING_COMMAND_SHARE * trajectory.durations[1:]
    edges = np.diff(resting.astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [
        (int(start), int(end))
        for start, end in zip(begins, ends, strict=True)
        if trajectory.durations[start + 1 : end + 1].sum() >= MIN_COMMANDED_REST_S
    ]


def _early(trajectory: BenchmarkTrajectory, passed: Array, of: Mask) -> float:
    """Return the maximum time by which points are passed before their commanded times, s."""
    if trajectory.durations is None:
        return 0.0
    return float(np.max(np.cumsum(trajectory.durations)[of] - passed, initial=0.0))


def _overrun(positions: Array, last: Array, reached: int) -> float:
    """Return the maximum distance from the last point after reaching it."""
    after = positions[reached + 1 :]
    return float(np.max(np.abs(after - last))) if len(after) else 0.0


def _outside(positions: Array, limits: JointLimits) -> float:
    below, above = limits.position_min - positions, positions - limits.position_max
    return max(float(np.max(np.maximum(below, above))), 0.0)


def _step_cost(record: Record) -> float:
    """Return the 99th percentile of the cost of a step without planning, s, or 0 without steps."""
    plain = record.costs[~record.planned]
    return float(np.percentile(plain, 99)) if plain.size else 0.0
