# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What happened in a demo run, in figures and as a picture, from the joint states that came."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from epson_driver.motion import Array, Trajectory

STILL, MOVING = 0.03, 0.1
"""Below the first share of the run's typical speed the arm has stopped, above the second it moves
again; between them the noise of the arrival times decides nothing."""

DEVIATION_ALLOWED = 0.02
"""How far from a waypoint the nearest joint state may be, rad: between two of them, 5 ms apart,
the arm moves on."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Joint states in the order they came: times (k,), s; positions, velocities (k, n)."""

    times: Array
    positions: Array
    velocities: Array


@dataclass(frozen=True, eq=False)
class Figures:
    """The run in numbers. Times in s, angles in rad."""

    planned: float
    moved: float
    waypoint_deviation: float
    end_deviation: float
    stops: int
    rate: float
    longest_gap: float
    waypoint_times: Array
    begin: float


def measure(trajectory: Trajectory, run: Recording) -> Figures:
    """Return the figures of a run; the joints of both are in the same order."""
    speeds = _speeds(run)
    moving = np.flatnonzero(speeds > STILL)
    first, last = (int(moving[0]), int(moving[-1])) if moving.size else (0, 0)
    distances, times = _waypoints(trajectory, run)
    gaps = np.diff(run.times)
    return Figures(
        planned=trajectory.duration,
        moved=float(run.times[last] - run.times[first]),
        waypoint_deviation=float(distances.max()),
        end_deviation=float(np.abs(run.positions[-1] - trajectory.positions[-1]).max()),
        stops=_stops(speeds),
        rate=float(len(gaps) / (run.times[-1] - run.times[0])),
        longest_gap=float(gaps.max()),
        waypoint_times=times,
        begin=float(run.times[first]),
    )


def _speeds(run: Recording) -> Array:
    """Return the fastest joint's speed at each state, as a share of the run's median, shape (k,).

    From each state's neighbours. The median, since states that come in a burst look too fast.
    """
    steps = np.abs(run.positions[2:] - run.positions[:-2]).max(axis=1)
    between = np.maximum(run.times[2:] - run.times[:-2], 1e-3)
    speeds = np.pad(steps / between, 1)
    typical = np.median(speeds[speeds > 0.0]) if speeds.any() else 1.0
    return np.asarray(speeds / typical)


def _stops(speeds: Array) -> int:
    """Return how often the arm stopped and moved on."""
    moving = speeds >= MOVING
    decided = moving | (speeds <= STILL)
    begins = np.flatnonzero(np.diff(moving[decided].astype(int)) == 1)
    return max(len(begins) - 1, 0)


def _waypoints(trajectory: Trajectory, run: Recording) -> tuple[Array, Array]:
    """Return how near each waypoint was passed, rad, and when, s; shapes (n,).

    The passages are in the waypoints' order and together the nearest possible (dynamic
    programming over waypoints and states), so that a path may cross itself.
    """
    states = np.arange(len(run.times))
    came_from = np.empty((len(trajectory.positions), len(states)), dtype=np.int32)
    cost = np.zeros(len(states))
    for index, waypoint in enumerate(trajectory.positions):
        lowest = np.minimum.accumulate(cost)
        came_from[index] = np.maximum.accumulate(np.where(cost <= lowest, states, 0))
        cost = lowest + np.abs(run.positions - waypoint).max(axis=1)
    passages = [int(np.argmin(cost))]
    for index in range(len(trajectory.positions) - 1, 0, -1):
        passages.append(int(came_from[index, passages[-1]]))
    passages.reverse()
    distances = np.abs(run.positions[passages] - trajectory.positions).max(axis=1)
    return distances, run.times[passages]


def draw(path: Path, trajectory: Trajectory, run: Recording, figures: Figures) -> None:
    """Write the picture: measured positions and velocities over time, waypoints as dots."""
    import matplotlib as mpl

    mpl.use('Agg')
    from matplotlib import pyplot as plt

    figure, (above, below) = plt.subplots(2, 1, figsize=(11, 7.5), sharex=True)
    shown = run.times >= figures.begin - 0.2
    times = run.times[shown] - figures.begin
    for joint, name in enumerate(trajectory.joint_names):
        (line,) = above.plot(times, run.positions[shown, joint], label=name, linewidth=1.4)
        above.plot(
            figures.waypoint_times - figures.begin,
            trajectory.positions[:, joint],
            'o',
            color=line.get_color(),
            markersize=3.5 if len(trajectory.times) <= 60 else 1.5,
        )
        below.plot(times, run.velocities[shown, joint], color=line.get_color(), linewidth=1.2)
    above.set_ylabel('position [rad]')
    above.set_title(
        f'{len(trajectory.times)} points, planned {figures.planned:.2f} s, '
        f'executed in {figures.moved:.2f} s, {figures.stops} stops on the way '
        '(dots: waypoints, where the arm passed them)',
        fontsize=10.5,
    )
    above.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), frameon=False)
    below.set_ylabel('velocity [rad/s]')
    below.set_xlabel('time since the arm began to move [s]')
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.margins(x=0.01)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
