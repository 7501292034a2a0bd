# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver demo`: executes a planned trajectory through ROS 2 on a simulated controller.

The demo starts sim_controller and client as separate processes, enables the arm, sends the
trajectory as a FollowJointTrajectory goal, and reports the measured motion. With --compare the
demo runs twice, first with a controller that rests at every point, then with a controller that
smooths the motion. With --stay, controller and driver keep running afterwards, with a panel in the
browser.
"""

import argparse
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from epson_driver.cli.arguments import (
    Parser,
    add_controller,
    add_robot,
    page,
    parsed,
    picture,
)
from epson_driver.demo.run import run
from epson_driver.inputs import InputError, printable
from epson_driver.motion import Trajectory
from epson_driver.panel import INSTALL as INSTALL_PANEL
from epson_driver.panel import missing as panel_missing
from epson_driver.processes.interrupt import INTERRUPTED, raise_at_first_signal
from epson_driver.processes.processes import RunError
from epson_driver.profiles import load_controller_profile
from epson_driver.report.run import RunError as ReportError
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.robots.model import SCARA, SIX_AXIS
from epson_driver.share import share_path
from epson_driver.trajectory_file import read_trajectory

TRAJECTORY = share_path('config', 'trajectories', 'around_pillar_11_points.yaml')
TRAJECTORY_OF_SCARAS = share_path('config', 'trajectories', 'scara_pick_and_place.yaml')

NATIVE = 'simulated'
"""Profile of the built-in program, with which --compare compares a SPEL+ program."""


def main() -> int:
    arguments = _arguments()
    console = Console()
    if arguments.panel and panel_missing():
        console.print(INSTALL_PANEL, highlight=False, markup=False)
        return 2
    raise_at_first_signal()
    try:
        return run(
            _fitting(arguments.trajectory, arguments.model),
            arguments.robot,
            _motions(arguments),
            arguments.picture,
            arguments.report,
            console,
            staying=arguments.stay or arguments.panel,
        )
    except (RunError, ReportError, InputError, OSError) as error:
        text = f'[bold red]demo failed:[/] {escape(printable(error))}'
        console.print(text, highlight=False, soft_wrap=True)
        return 1
    except KeyboardInterrupt:
        console.print('stopped')
        return INTERRUPTED


def _arguments() -> argparse.Namespace:
    parser = Parser(
        'demo',
        'Execute a planned trajectory through ROS 2 on a simulated robot, and report on it.',
        ('demo --panel', 'demo --robot ls6_602s --compare'),
        '0 the arm followed the plan, 1 it did not, 2 invalid arguments, 3 uncertain, 130 Ctrl-C',
    )
    add_robot(parser)
    parser.option(
        '--trajectory FILE',
        f'JointTrajectory as YAML (default: {TRAJECTORY.name}, for SCARAs '
        f'{TRAJECTORY_OF_SCARAS.name})',
        Path,
    )
    add_controller(parser, 'controller profile (spel: the SPEL+ program for real controllers)')
    parser.add_argument(
        '--motion',
        choices=('smooth', 'ptp'),
        help='smooth: through all points without a stop, ptp: rest at each (default: smooth)',
    )
    parser.option(
        '--compare',
        'comparison of both motions, or of a SPEL+ program with the built-in program of '
        f'{NATIVE}, in one picture',
    )
    parser.option(
        '--picture FILE', 'plot of positions and velocities', picture, Path('demo-report.png')
    )
    parser.option('--report FILE', 'report page (default: next to the picture)', page)
    parser.option(
        '--stay', 'keep controller, driver and, if it is installed, the panel running until Ctrl-C'
    )
    parser.option('--panel', 'like --stay, but fail without the panel')
    arguments = parsed(parser)
    arguments.report = arguments.report or arguments.picture.with_suffix('.html')
    try:
        arguments.model = load_robot_model(arguments.robot)
        profile = load_controller_profile(arguments.controller)
    except (OSError, InputError) as error:
        parser.error(str(error))
    arguments.spel = bool(profile.spel.project)
    if arguments.spel and arguments.motion is not None:
        parser.error('--motion: its statements determine how a SPEL+ program moves')
    if arguments.trajectory is None:
        scara = arguments.model.kind == SCARA
        arguments.trajectory = TRAJECTORY_OF_SCARAS if scara else TRAJECTORY
    if arguments.model.kind not in (SIX_AXIS, SCARA):
        parser.error(f'--robot: {arguments.model.name} is neither a six-axis arm nor a SCARA')
    if arguments.compare and (arguments.stay or arguments.panel):
        parser.error('--compare has two runs: leave out --stay and --panel')
    return arguments


def _fitting(file: Path, model: RobotModel) -> Trajectory:
    trajectory = read_trajectory(file)
    if sorted(trajectory.joint_names) != sorted(model.joint_names):
        raise InputError(
            f'{file}: its joints are {", ".join(trajectory.joint_names)}, but the {model.name} '
            f'has {", ".join(model.joint_names)}: select its model with --robot'
        )
    return trajectory.in_order(model.joint_names)


def _motions(arguments: argparse.Namespace) -> list[tuple[str, str]]:
    profile = arguments.controller
    if arguments.spel:
        return [*([('smooth', NATIVE)] if arguments.compare else []), ('spel', profile)]
    motions = ('ptp', 'smooth') if arguments.compare else (arguments.motion or 'smooth',)
    return [(motion, profile) for motion in motions]
