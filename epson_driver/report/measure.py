# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Computes duration, stops and deviations of one motion from the received joint states."""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion import Array, Trajectory
from epson_driver.motion.closest_samples import closest_sample_indices

STOPPED_FRACTION, MOVING_FRACTION = 0.06, 0.15
"""Fractions of the typical speed below which the arm has stopped, and above which it moves again.
The hysteresis suppresses the noise of arrival times."""

NEIGHBOURS = 2  # number of joint states on either side from which a speed is computed
MAX_DEVIATION_RAD = 0.02
"""Maximum distance of the path from a waypoint in a correct motion, rad. The path between two
joint states is assumed to be straight, which causes an error of 1 mrad if they are 14 ms apart."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Joint states in the order of their arrival.

    `times`, s, has the shape (k,), and the other arrays have the shape (k, n).
    """

    times: Array
    positions: Array
    velocities: Array


@dataclass(frozen=True, eq=False)
class Figures:
    """Measured values of one motion. Times in s, deviations in rad, speed in rad/s, rate in Hz.

    `stops` counts stops that are not in the plan, and `commanded_stops` counts stops that are.
    `waypoint_times` has the shape (n,).
    """

    planned: float
    moved: float
    waypoint_deviation: float
    end_deviation: float
    stops: int
    commanded_stops: int
    top_speed: float
    rate: float
    longest_gap: float
    waypoint_times: Array
    start: float


def measure(trajectory: Trajectory, run: Recording, metric: Array | None = None) -> Figures:
    """Return the measured values of a motion. The trajectory has the joints in the same order.

    `metric`: JointLimits.rad_per_unit, shape (n,), needed if some joints are prismatic.
    """
    if metric is not None:
        names, times = trajectory.joint_names, trajectory.times
        trajectory = Trajectory(names, times, trajectory.positions * metric)
        run = Recording(run.times, run.positions * metric, run.velocities * metric)
    speeds = _speeds(run)
    moving = np.flatnonzero(speeds > STOPPED_FRACTION)
    first, last = (int(moving[0]), int(moving[-1])) if moving.size else (0, 0)
    distances, times = _waypoints(trajectory, run)
    gaps = np.diff(run.times)
    stops, commanded = _stops(speeds), _commanded_stops(trajectory)
    return Figures(
        planned=trajectory.duration,
        moved=float(run.times[last] - run.times[first]),
        waypoint_deviation=float(distances.max()),
        end_deviation=float(np.abs(run.positions[-1] - trajectory.positions[-1]).max()),
        stops=max(stops - commanded, 0),
        commanded_stops=min(stops, commanded),
        top_speed=float(np.abs(run.velocities).max()),
        rate=float(len(gaps) / (run.times[-1] - run.times[0])),
        longest_gap=float(gaps.max()),
        waypoint_times=times,
        start=float(run.times[first]),
    )


def _speeds(run: Recording) -> Array:
    """Return the speed of the fastest joint at each state, relative to the median, shape (k,).

    A speed is computed over two states on either side, so that a single late state does not count
    as a stop. The median is the reference, because states that arrive in a burst appear too fast.
    """
    steps = np.abs(run.positions[2 * NEIGHBOURS :] - run.positions[: -2 * NEIGHBOURS]).max(axis=1)
    between = np.maximum(run.times[2 * NEIGHBOURS :] - run.times[: -2 * NEIGHBOURS], 1e-3)
    speeds = np.pad(steps / between, NEIGHBOURS)
    typical = np.median(speeds[speeds > 0.0]) if speeds.any() else 1.0
    return np.asarray(speeds / typical)


def _stops(speeds: Array) -> int:
    moving = speeds >= MOVING_FRACTION
    decided = moving | (speeds <= STOPPED_FRACTION)
    starts = np.flatnonzero(np.diff(moving[decided].astype(int)) == 1)
    return max(len(starts) - 1, 0)


def _commanded_stops(trajectory: Trajectory) -> int:
    if len(trajectory.times) < 3:
        return 0
    steps = np.diff(trajectory.positions, axis=0) / np.diff(trajectory.times)[:, None]
    speeds = np.abs(steps if trajectory.velocities is None else trajectory.velocities).max(axis=1)
    moving = speeds[speeds > 0.0]
    return _stops(np.pad(speeds / np.median(moving), 1)) if moving.size else 0


def _waypoints(trajectory: Trajectory, run: Recording) -> tuple[Array, Array]:
    """Return the distance of the path from each waypoint, rad, and the time of passing it, s.

    Both have the shape (n,).
    """
    samples = closest_sample_indices(trajectory.positions, run.positions)
    distances = np.abs(run.positions[samples] - trajectory.positions).max(axis=1)
    fraction = np.linspace(0.0, 1.0, 41)[:, None]
    for index, (waypoint, sample) in enumerate(
        zip(trajectory.positions, samples.tolist(), strict=True)
    ):
        for first in (sample - 1, sample):
            if 0 <= first < len(run.positions) - 1:
                start, end = run.positions[first], run.positions[first + 1]
                line = np.abs(start + fraction * (end - start) - waypoint).max(axis=1)
                distances[index] = min(distances[index], line.min())
    return distances, run.times[samples]
