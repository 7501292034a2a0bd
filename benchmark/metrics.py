# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a sampled motion is judged by, computed from its samples alone."""

from dataclasses import dataclass

import numpy as np

from benchmark.motion_record import Mask, Record
from benchmark.trajectories import BenchmarkTrajectory
from benchmark.waypoints import may_be_merged, passages
from epson_driver.motion import Array, JointLimits

MERGE_TOLERANCE_RAD = 5e-4
"""How far the smoother may pass from a waypoint that lies as close to another one, rad."""
ARRIVED_DISTANCE_RAD = 1e-6
"""The motion is over once it stays so close to its last position, rad."""
REST_VELOCITY_SHARE = 1e-4
"""Share of the velocity limit below which a joint rests; the arm, if all do."""
TURNING_ACCELERATION_SHARE = 0.05
"""Share of the acceleration limit above which an arm without speed turns round, and is no stop."""
STEADY_ACCELERATION_RATIO = 0.6
"""So does an arm whose acceleration, beside the samples without speed as well, never falls below
this share of what it reaches there: at a stop it is 0."""
MIN_STOP_SAMPLES = 2
MIN_COMMANDED_REST_S = 0.2
"""A command that asks for no motion for so long is a stop that was asked for, s."""
REST_TOLERANCE_S = 0.1
"""How far from a commanded rest a stop may be to count as that rest, s."""
RESTING_COMMAND_SHARE = 2e-3
"""Share of the velocity limit below which a command asks for no motion."""


@dataclass(frozen=True)
class Metrics:
    """Figures of one motion. Times in s, angles in rad, velocity … jerk as shares of the limits.

    waypoint: farthest from a waypoint; of those that may be merged, only the excess over the
    merge tolerance. early: how long before its time a point is passed at most. overrun: farthest
    from the last point after it was reached first. mismatch: largest difference between what the
    velocities and accelerations say and how the positions change, as a share of the limit.
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
    """Return the figures of a motion along a trajectory; `timed` if it had to keep the times."""
    positions = record.positions
    last = trajectory.positions[-1]
    passed = passages(trajectory.positions, record)
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
    """Return when the motion is over for good: close to its end, and at rest."""
    away = np.max(np.abs(record.positions - record.positions[-1]), axis=1) > ARRIVED_DISTANCE_RAD
    moving = np.flatnonzero(away)
    return record.dt * float(moving[-1] + 1) if moving.size else 0.0


def _mismatch(record: Record, limits: JointLimits) -> float:
    """Hold the velocities and accelerations against the positions' changes.

    Over a step, position changes by the mean velocity (less a term of the accelerations), the
    velocity by the mean acceleration: exact for constant jerk.
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
    """Count stops on the way that the command did not ask for."""
    rests = commanded_rests(trajectory, limits) if timed else []
    times = [
        (passed[first] - REST_TOLERANCE_S, passed[last] + REST_TOLERANCE_S)
        for first, last in rests
    ]
    made = [(record.dt * first, record.dt * last) for first, last in stops(record, limits)]
    return sum(
        not any(begin <= last and first <= end for begin, end in times) for first, last in made
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
        (int(begin), int(end))
        for begin, end in zip(begins, ends, strict=True)
        if end - begin + 1 >= MIN_STOP_SAMPLES and not _turns(push[begin - 1 : end + 2])
    ]


def _turns(push: Array) -> bool:
    """Return whether an arm turns round, from its acceleration while it has no speed."""
    return bool(push.min() > STEADY_ACCELERATION_RATIO * push.max())


def commanded_rests(trajectory: BenchmarkTrajectory, limits: JointLimits) -> list[tuple[int, int]]:
    """Return between which points, first and last, the command asks for no motion."""
    if trajectory.durations is None:
        return []
    steps = np.max(np.abs(np.diff(trajectory.positions, axis=0)) / limits.velocity, axis=1)
    resting = steps <= RESTING_COMMAND_SHARE * trajectory.durations[1:]
    edges = np.diff(resting.astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [
        (int(begin), int(end))
        for begin, end in zip(begins, ends, strict=True)
        if trajectory.durations[begin + 1 : end + 1].sum() >= MIN_COMMANDED_REST_S
    ]


def _early(trajectory: BenchmarkTrajectory, passed: Array, of: Mask) -> float:
    """Return how long before their commanded times some of the points are passed at most, s."""
    if trajectory.durations is None:
        return 0.0
    return float(np.max(np.cumsum(trajectory.durations)[of] - passed, initial=0.0))


def _overrun(positions: Array, last: Array, reached: int) -> float:
    """Return how far the motion is from the last point once it has reached it."""
    after = positions[reached + 1 :]
    return float(np.max(np.abs(after - last))) if len(after) else 0.0


def _outside(positions: Array, limits: JointLimits) -> float:
    below, above = limits.position_min - positions, positions - limits.position_max
    return max(float(np.max(np.maximum(below, above))), 0.0)


def _step_cost(record: Record) -> float:
    """Return the 99th percentile of the cost of a step without planning, s; 0 without steps."""
    plain = record.costs[~record.planned]
    return float(np.percentile(plain, 99)) if plain.size else 0.0
