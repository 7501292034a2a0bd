# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The plot of a demo run, from the received joint states and the wire trace."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from epson_driver.error_texts import load_error_texts
from epson_driver.motion import JointLimits, Trajectory
from epson_driver.report.measure import Figures, Recording
from epson_driver.report.run import Run
from epson_driver.report.smooth_study import (
    COLOURS,
    per_unit,
    pyplot,
    save_picture,
    stops_during_motion,
)
from epson_driver.report.trace_run import read_trace
from epson_driver.robots import RobotModel

TRACE = 'demo.pcap'  # the driver's trace, in the folder of the demo's logs
WRITTEN_S = 0.3  # before reading the trace: the driver flushes it slightly more often
MAX_READS = 10


def recorded_run(trace: Path, model: RobotModel, what: str) -> Run:
    """Return the run until now, from a trace that a driver is still writing.

    The trace is read repeatedly until it contains messages that are newer than this call.
    """
    until = time.time_ns()
    for _ in range(MAX_READS):
        time.sleep(WRITTEN_S)
        run = read_trace(trace, model.limits, load_error_texts())
        if run.nanoseconds(run.ended) >= until:
            break
    return replace(run, source=f'demo, {what}')


@dataclass(frozen=True, eq=False)
class Drawn:
    title: str
    run: Recording
    figures: Figures


def top_speed(recording: Recording, limits: JointLimits) -> str:
    """Return the highest joint velocity in each unit as a text, as in '1.57 rad/s, 0.40 m/s'."""
    fastest = np.abs(recording.velocities).max(axis=0)
    units = np.array(limits.units)
    return ', '.join(
        f'{fastest[units == unit].max():.2f} {unit}/s' for unit in dict.fromkeys(units.tolist())
    )


def draw(path: Path, trajectory: Trajectory, drawn: Sequence[Drawn], limits: JointLimits) -> None:
    """Write the plot, with one column for each run.

    The dots are waypoints, drawn at the time when the arm passed them.
    """
    figure, grid = pyplot().subplots(
        2,
        len(drawn),
        figsize=(11, 7.5),
        sharex=True,
        sharey='row',
        squeeze=False,
        layout='constrained',
        gridspec_kw={'height_ratios': (1.2, 1)},
    )
    for (above, below), item in zip(grid.T, drawn, strict=True):
        _draw_run(above, below, trajectory, item, top_speed(item.run, limits))
    grid[0, 0].set_ylabel(f'position [{per_unit(limits)}]')
    grid[1, 0].set_ylabel(f'velocity [{per_unit(limits, "/s")}]')
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', ncols=8, frameon=False)
    figure.suptitle(
        f'{len(trajectory.times)} points, planned to take {trajectory.duration:.2f} s, as '
        'measured (dots: the points when the arm passed them)',
        fontsize=11,
    )
    save_picture(path, figure)


def _draw_run(above: Any, below: Any, trajectory: Trajectory, drawn: Drawn, fastest: str) -> None:
    run, figures = drawn.run, drawn.figures
    shown = run.times >= figures.start - 0.2
    times = run.times[shown] - figures.start
    marker = 4.0 if len(trajectory.times) <= 60 else 1.5
    for joint, name in enumerate(trajectory.joint_names):
        colour = COLOURS[joint % len(COLOURS)]
        above.plot(times, run.positions[shown, joint], color=colour, label=name, linewidth=1.5)
        above.plot(
            figures.waypoint_times - figures.start,
            trajectory.positions[:, joint],
            'o',
            color=colour,
            markersize=marker,
        )
        below.plot(times, run.velocities[shown, joint], color=colour, linewidth=1.3)
    text = f'{figures.moved:.2f} s, {stops_during_motion(figures)}, at most {fastest}'
    above.set_title(f'{drawn.title}: {text}', fontsize=10.5)
    below.set_xlabel('time since the start of the motion [s]')
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.margins(x=0.01)
