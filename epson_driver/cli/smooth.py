# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver smooth FILE`: smooths a planned trajectory offline, without a robot.

The command writes the smooth trajectory in the same format. It also compares the smooth
trajectory, in a table and a plot, with the motion of a point-to-point controller and with a plain
spline.
"""

import argparse
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from epson_driver.cli.arguments import Parser, add_robot, parsed, picture
from epson_driver.inputs import InputError, number
from epson_driver.motion import JointLimits, Trajectory, smooth
from epson_driver.motion.closest_samples import passed
from epson_driver.motion.fastest import MAX_PATH_TOLERANCE
from epson_driver.motion.smoothed import every
from epson_driver.motion.smoother import MERGE_TOLERANCE, Mode, Plan, Request, plan
from epson_driver.report.smooth_study import (
    Column,
    SmoothingComparison,
    draw,
    measure,
    point_to_point,
    spline,
)
from epson_driver.robots import load_robot_model
from epson_driver.trajectory_file import read_trajectory, write_trajectory

SAMPLE_PERIOD_S = 0.001
"""Time between the samples for the table and the plot, s."""

MIN_LOOK_AHEAD_S = 0.01
"""Minimum look-ahead, s. With a shorter one, the arm creeps and planning takes too long."""

NO_PICTURE = "none, as matplotlib is missing: pip install 'epson_driver[report]'"


def main() -> int:
    parser = _parser()
    arguments = parsed(parser)
    try:
        return _run(arguments)
    except (OSError, InputError) as error:
        print(f'{parser.prog}: error: {error}', file=sys.stderr)
        return 2


def _run(arguments: argparse.Namespace) -> int:
    console = Console()
    draws = find_spec('matplotlib') is not None
    if arguments.picture and not draws:
        raise InputError(f'--picture: {NO_PICTURE}')
    file: Path = arguments.file
    mode = Mode(arguments.mode)
    limits = load_robot_model(arguments.robot).limits
    trajectory = _checked(file, read_trajectory(file, timed=False), limits, mode)
    timed = bool(trajectory.times.any())
    planner = _CountingPlanner()
    parts = max(round(1.0 / arguments.rate / SAMPLE_PERIOD_S), 1)
    period = 1.0 / arguments.rate
    started = time.perf_counter()
    try:
        with console.status('planning'):
            smoothed = smooth(
                trajectory.positions,
                limits,
                trajectory.times if mode is Mode.TIME_PRESERVING else None,
                look_ahead=arguments.look_ahead,
                period=period / parts,
                planner=planner,
                refine=not arguments.keep_spline,
                path_tolerance=arguments.path_tolerance,
            )
    except ValueError as error:
        raise InputError(f'{file}: {error}') from error
    planned = f'one for all points, in {(time.perf_counter() - started) * 1e3:.0f} ms'
    output = arguments.output or Path(f'{file.stem}_smooth.yaml')
    picture = arguments.picture or Path(f'{file.stem}_smooth.png')
    about = f'{file.name}, smoothed ({mode.value}), one point every {period * 1e3:g} ms'
    write_trajectory(output, every(smoothed, parts), about)
    command = trajectory if mode is Mode.TIME_PRESERVING else None
    others = {'point to point, full speed': point_to_point(trajectory, limits)}
    if timed:
        kind = 'cubic' if trajectory.accelerations is None else 'quintic'
        others[f'{kind} spline'] = spline(trajectory)
    columns = [
        Column(title, motion, times, measure(motion, None, limits))
        for title, (motion, times) in others.items()
    ]
    errors, times = passed(trajectory.positions, smoothed)
    figures = measure(smoothed, command, limits)
    title = f'smoothed, {mode.value.replace("_", " ")}'
    columns.append(Column(title, smoothed, times, figures, float(errors.max())))
    study = SmoothingComparison(trajectory, limits, timed, columns)
    console.print(_table(study, planner.summary or planned, arguments.look_ahead))
    if draws:
        draw(picture, study)
    shown = picture if draws else NO_PICTURE
    console.print(f'trajectory: {output}\npicture: {shown}', highlight=False, markup=False)
    return 0


class _CountingPlanner:
    def __init__(self) -> None:
        self._times: list[float] = []

    def __call__(self, request: Request, limits: JointLimits) -> Plan | None:
        started = time.perf_counter()
        result = plan(request, limits)
        self._times.append(time.perf_counter() - started)
        return result

    @property
    def summary(self) -> str:
        if not self._times:
            return ''
        total, longest = sum(self._times) * 1e3, max(self._times) * 1e3
        return f'{len(self._times)} in {total:.0f} ms, the longest {longest:.0f} ms'


def _checked(file: Path, trajectory: Trajectory, limits: JointLimits, mode: Mode) -> Trajectory:
    names = trajectory.joint_names
    if sorted(names) != sorted(limits.names):
        raise InputError(
            f'{file}: its joints are {", ".join(names)}, but the robot '
            f'has {", ".join(limits.names)}: '
            'rename them, or select another robot with --robot'
        )
    trajectory = trajectory.in_order(limits.names)
    if mode is Mode.TIME_PRESERVING and len(trajectory.times) > 1 and not trajectory.times.any():
        raise InputError(
            f'{file}: no point has a time: add time_from_start, or use --mode time_optimal'
        )
    return trajectory


def _table(study: SmoothingComparison, planned: str, look_ahead: float) -> Table:
    ours, stop_and_go = study.columns[-1].figures, study.columns[0].figures
    error = study.columns[-1].waypoint_error
    units = ' or '.join(dict.fromkeys(study.limits.units))
    known = 'all points known' if np.isinf(look_ahead) else f'{look_ahead:g} s known ahead'
    duration = f'{ours.duration:.3f} s ({known})'
    commanded = 'the plan has no times'
    if study.timed:
        commanded_s = study.plan.duration - float(study.plan.times[0])
        ratio = f', {ours.duration / commanded_s:.3f} times' if commanded_s > 0.0 else ''
        commanded = f'{commanded_s:.3f} s{ratio}'
    stops = f'{ours.stops}'
    if ours.commanded_stops:
        stops += f', and {ours.commanded_stops} in the plan'
    times = ours.duration / stop_and_go.duration if stop_and_go.duration else 1.0
    rows = (
        ('points', f'{len(study.plan.times)}'),
        ('duration', duration),
        ('commanded', commanded),
        ('point to point', f'{stop_and_go.duration:.3f} s, {times:.3f} times'),
        ('intermediate stops', stops),
        ('highest velocity', f'{ours.velocity:.3f} of the limit'),
        ('highest acceleration', f'{ours.acceleration:.3f} of the limit'),
        ('highest jerk', f'{ours.jerk:.3f} of the limit'),
        (
            'worst waypoint error',
            f'{error:.1e} {units} (points closer than {MERGE_TOLERANCE:g} {units} count as one)',
        ),
        ('plans', planned),
    )
    table = Table(show_header=False, title='The smooth motion', title_justify='left')
    for row in rows:
        table.add_row(*row)
    return table


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        'smooth',
        'Smooth a planned trajectory within all joint limits and without intermediate stops, '
        'and compare it with point-to-point motion and a plain spline.',
        ('smooth plan.yaml', 'smooth plan.yaml --mode time_optimal --output fast.yaml'),
        '0 done, 2 invalid arguments, 130 Ctrl-C',
    )
    parser.add_argument('file', type=Path, metavar='FILE', help='JointTrajectory as YAML')
    parser.add_argument(
        '--mode',
        choices=[mode.value for mode in Mode],
        default=Mode.TIME_PRESERVING.value,
        help='time_preserving: times of the plan where the limits allow them, time_optimal: as '
        'fast as the limits allow (default: %(default)s)',
    )
    parser.option(
        '--look-ahead S',
        'time ahead of the arm for which points are known, s, as in a stream '
        '(default: all points are known)',
        number(MIN_LOOK_AHEAD_S, np.inf, 's'),
        np.inf,
    )
    parser.option(
        '--path-tolerance RAD',
        'maximum joint deviation from the waypoints except the first and last: 0, or with '
        '--mode time_preserving at least 0.001 (default: %(default)g)',
        number(0.0, MAX_PATH_TOLERANCE, 'rad'),
        0.0,
    )
    parser.option(
        '--keep-spline',
        'with --mode time_optimal: follow the spline through the points, which bends less '
        'between them than the fastest path',
    )
    parser.option('--output FILE', 'smooth trajectory (default: NAME_smooth.yaml)', Path)
    parser.option(
        '--picture FILE',
        'plot file, needs matplotlib (default: NAME_smooth.png, or none without matplotlib)',
        picture,
    )
    add_robot(parser)
    parser.option(
        '--rate HZ', 'points per second (default: %(default)g)', number(1.0, 1000.0, 'Hz'), 250.0
    )
    return parser
