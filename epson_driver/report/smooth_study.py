# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Compares a smooth motion with other motions through the same points, in numbers and a plot."""

import io
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from epson_driver.inputs import write_file
from epson_driver.motion import Array, JointLimits, Trajectory, go
from epson_driver.motion.interpolation import Interpolation, central_differences
from epson_driver.motion.smoother.waypoints import MIN_DWELL_S

SAMPLE_RATE_HZ = 1000.0  # sample rate of the point-to-point motion and of the spline, Hz

COLOURS = ('#0072B2', '#E69F00', '#009E73', '#D55E00', '#CC79A7', '#56B4E9', '#000000', '#8A8000')
"""Colours of the joints: Okabe and Ito's palette for colour-blind people, with a darker yellow."""

MAX_AXIS_RATIOS = (1.35, 2.5, 4.0)  # ends of the velocity, acceleration, jerk axes / limit
MAX_SHARED_TIME_RATIO = 3.0  # longest / shortest duration for a common time scale
REST_VELOCITY_FRACTION = 1e-3  # fraction of its velocity limit below which a joint is at rest
TURNING_ACCELERATION_FRACTION = 0.05  # of its limit, above which a joint at zero speed reverses
RESTING_COMMAND_SHARE = 2e-3  # of the velocity limit, up to which a command is a rest


@dataclass(frozen=True)
class Figures:
    """Measurements of a motion.

    `velocity`, `acceleration` and `jerk` are the highest values of any joint, as fractions of its
    limit. The jerk is the acceleration difference of two samples divided by the time between them.
    """

    duration: float  # time from the first to the last sample, s
    stops: int  # stops between start and end that were not commanded
    commanded_stops: int
    velocity: float
    acceleration: float
    jerk: float


def measure(motion: Trajectory, command: Trajectory | None, limits: JointLimits) -> Figures:
    """Return the measurements of a motion with equally spaced samples.

    `command`: the plan, whose commanded standstills are not counted as stops, or None.
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
    """Return the number of stops between the start and the end of a motion.

    A stop lasts at least two samples. `speed` and `push` are the fractions of the velocity limit
    and of the acceleration limit that the motion uses at each sample.
    """
    at_rest = (speed < REST_VELOCITY_FRACTION) & (push < TURNING_ACCELERATION_FRACTION)
    moving = np.flatnonzero(speed >= REST_VELOCITY_FRACTION)
    if not moving.size:
        return 0
    inside = at_rest[moving[0] : moving[-1]].astype(np.int8)
    edges = np.diff(inside, prepend=0, append=0)
    return int(np.sum(np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1) >= 2))


def commanded_rests(command: Trajectory, limits: JointLimits) -> int:
    """Return the number of standstills that a plan commands between its start and its end.

    Shorter standstills than MIN_DWELL_S do not count.
    """
    durations = np.diff(command.times)
    distances = np.max(np.abs(np.diff(command.positions, axis=0)) / limits.velocity, axis=1)
    resting = distances <= RESTING_COMMAND_SHARE * durations
    moving = np.flatnonzero(~resting)
    if not moving.size:
        return 0
    inside = slice(moving[0], moving[-1])
    edges = np.diff(resting[inside].astype(np.int8), prepend=0, append=0)
    elapsed = np.concatenate([[0.0], np.cumsum(durations[inside])])
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return int(np.sum(elapsed[ends] - elapsed[starts] >= MIN_DWELL_S))


def per_unit(limits: JointLimits, per: str = '') -> str:
    """Return the units of the joints followed by `per`, such as 'rad/s' or 'rad/s, m/s'."""
    return ', '.join(f'{unit}{per}' for unit in dict.fromkeys(limits.units))


@dataclass(frozen=True, eq=False)
class Column:
    """A sampled motion through the points of a plan, drawn in one column of the plot.

    `passed`: times at which the motion passes the points, s, shape (n,). `waypoint_error`: largest
    error of any joint at the points, rad or m.
    """

    title: str
    motion: Trajectory
    passed: Array
    figures: Figures
    waypoint_error: float = 0.0


@dataclass(frozen=True, eq=False)
class SmoothingComparison:
    """A plan, and several motions through its points.

    The last of these motions is the smooth one.
    """

    plan: Trajectory
    limits: JointLimits
    timed: bool
    columns: list[Column]


def point_to_point(plan: Trajectory, limits: JointLimits) -> tuple[Trajectory, Array]:
    """Return the motion that stops at every point, and the times of these stops, s, shape (n,)."""
    moves = [go(limits, start, target) for start, target in pairwise(plan.positions)]
    reached = np.concatenate([[0.0], np.cumsum([move.duration for move in moves])])
    times = np.arange(0.0, reached[-1] + 1.0 / SAMPLE_RATE_HZ, 1.0 / SAMPLE_RATE_HZ)
    index = np.clip(np.searchsorted(reached, times, 'right') - 1, 0, max(len(moves) - 1, 0))
    if moves:
        since = (times - reached[index]).tolist()
        states = [moves[i].at(time) for i, time in zip(index, since, strict=True)]
    else:
        states = [(plan.positions[0], *np.zeros((2, len(limits.names))))] * len(times)
    position, velocity, acceleration = (np.array(part) for part in zip(*states, strict=True))
    return Trajectory(plan.joint_names, times, position, velocity, acceleration), reached


def spline(plan: Trajectory) -> tuple[Trajectory, Array]:
    """Return the motion that joint_trajectory_controller would execute, sampled.

    Also return the times at which this motion passes the plan's points, s, shape (n,). They are
    the plan's times, even if the motion then exceeds the limits. Each segment is a quintic
    polynomial in time if the plan has accelerations, else a cubic one. Missing velocities are
    central differences. The first and the last acceleration are set to 0.
    """
    t, q = plan.times - plan.times[0], plan.positions
    if len(t) == 1:
        zero = np.zeros_like(q)
        return Trajectory(plan.joint_names, t, q, zero, zero), t
    v = central_differences(t, q) if plan.velocities is None else plan.velocities
    times = np.arange(0.0, t[-1] + 1.0 / SAMPLE_RATE_HZ, 1.0 / SAMPLE_RATE_HZ)
    within = np.minimum(times, t[-1])
    position, velocity, acceleration = Interpolation(t, q, v, plan.accelerations).at(within)
    acceleration[[0, -1]] = 0.0
    return Trajectory(plan.joint_names, times, position, velocity, acceleration), t


def draw(path: Path, study: SmoothingComparison) -> None:
    count = len(study.columns)
    figure, grid = pyplot().subplots(
        4,
        count,
        figsize=(3.7 * count + 0.3, 9.2),
        sharex='col',
        sharey='row',
        squeeze=False,
        layout='constrained',
        gridspec_kw={'height_ratios': (1.25, 1, 1, 1)},
    )
    durations = [item.figures.duration for item in study.columns]
    together = max(durations) <= MAX_SHARED_TIME_RATIO * min(durations)
    for place, element in enumerate(study.columns):
        _draw_column(grid[:, place], element, study)
        width = max(max(durations) if together else durations[place], 0.1)
        grid[0, place].set_xlim(-0.02 * width, 1.02 * width)
        grid[3, place].set_xlabel('time [s]' if together else 'time [s], separate scale')
    for row, limit in enumerate(_shown(study), start=1):
        grid[row, 0].set_ylim(-limit, limit)
    names = (
        f'position [{per_unit(study.limits)}]',
        'velocity / limit',
        'acceleration / limit',
        'jerk / limit',
    )
    for row, name in enumerate(names):
        grid[row, 0].set_ylabel(name)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', ncols=8, frameon=False)
    save_picture(path, figure)


def pyplot() -> Any:
    """Import matplotlib.pyplot for plots in files. Raises ImportError if it is missing."""
    import matplotlib as mpl

    mpl.use('Agg')
    from matplotlib import pyplot as plt

    return plt


def stops_during_motion(figures: Any) -> str:
    """Return a motion's number of stops as a text."""
    stops = figures.stops + figures.commanded_stops
    return f'{stops or "no"} stop{"s" * (stops > 1)} during the motion'


def save_picture(path: Path, figure: Any) -> None:
    """Write a figure in the format of the path's suffix, and close it."""
    content = io.BytesIO()
    figure.savefig(content, dpi=100, format=path.suffix[1:])
    pyplot().close(figure)
    write_file(path, content.getvalue())


def _shown(study: SmoothingComparison) -> list[float]:
    figures = [item.figures for item in study.columns]
    worst = np.max([(item.velocity, item.acceleration, item.jerk) for item in figures], axis=0)
    return [float(value) for value in np.clip(1.08 * worst, 1.25, MAX_AXIS_RATIOS)]


def _draw_column(axes: Any, drawn: Column, study: SmoothingComparison) -> None:
    motion, figures = drawn.motion, drawn.figures
    times = motion.times - motion.times[0]
    assert motion.velocities is not None  # noqa: S101 - for the type checker
    assert motion.accelerations is not None  # noqa: S101
    velocities = motion.velocities / study.limits.velocity
    accelerations = motion.accelerations / study.limits.acceleration
    jerks = np.diff(motion.accelerations, axis=0) / np.diff(motion.times)[:, None]
    rows = (
        (times, velocities, figures.velocity),
        (times, accelerations, figures.acceleration),
        (times[:-1], jerks / study.limits.jerk, figures.jerk),
    )
    marker = 4.0 if len(study.plan.times) <= 30 else 2.5 if len(study.plan.times) <= 100 else 1.2
    at_points = drawn.passed - drawn.passed[0]
    for joint, name in enumerate(motion.joint_names):
        colour = COLOURS[joint % len(COLOURS)]
        axes[0].plot(times, motion.positions[:, joint], color=colour, label=name, linewidth=1.5)
        axes[0].plot(
            at_points, study.plan.positions[:, joint], 'o', color=colour, markersize=marker
        )
    for part, (t, values, worst), shown in zip(axes[1:], rows, MAX_AXIS_RATIOS, strict=True):
        part.axhspan(-1.0, 1.0, color='#009E73', alpha=0.10, linewidth=0)
        for joint in range(values.shape[1]):
            part.plot(t, values[:, joint], color=COLOURS[joint % len(COLOURS)], linewidth=1.1)
        over = worst > 1.02
        part.text(
            0.98,
            0.95,
            f'up to {worst:#.3g} ×' + (', cut off' if worst > shown else ''),
            transform=part.transAxes,
            ha='right',
            va='top',
            fontsize=9.5,
            color='#B00020' if over else '#333333',
            weight='bold' if over else 'normal',
            bbox={'facecolor': 'white', 'alpha': 0.85, 'edgecolor': 'none', 'pad': 1.5},
        )
    message = f'{figures.duration:.2f} s, {stops_during_motion(figures)}'
    axes[0].set_title(f'{drawn.title}\n{message}', fontsize=11)
    for part in axes:
        part.grid(alpha=0.25)
        part.tick_params(labelsize=9)
