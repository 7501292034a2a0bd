# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver panel`: shows and operates robots in a browser."""

import argparse
import asyncio
import logging
import signal
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from epson_driver.aio import Robot
from epson_driver.api.ownership import Page
from epson_driver.api.simulation import SimulatedController
from epson_driver.cli.arguments import DEFAULT_MODEL, FREE_PORT, Parser, host
from epson_driver.cli.spel_options import DEFAULT_CONTROLLER, add_changes, changes_of
from epson_driver.inputs import InputError, printable
from epson_driver.panel import INSTALL, missing
from epson_driver.processes.interrupt import ended_by_signals, ending_signals
from epson_driver.processes.ros_shell import ros_problem
from epson_driver.setup.robot_file import is_robot_file
from epson_driver.spel import read_settings
from epson_driver.spel.errors import SETTINGS_FILE

PORT = 8080

NO_ROS = (
    'the Python module rclpy is missing: add --simulated or robot.yaml to show a robot without '
    'ROS, or source a ROS 2 workspace to show the drivers that run'
)
SHOWS_DRIVERS = (
    'the panel shows the drivers that run: start `epson_driver client` with this file, or add '
    '--no-ros'
)


def main() -> int:
    parser, problem = _parser(), ros_problem()
    try:
        words, ros = (sys.argv[1:], True) if problem else _words()
        options = parser.parse_args(words)
        without_ros = options.simulated or options.no_ros or (options.file and not ros)
        _check(parser, options, without_ros=without_ros)
    except (RuntimeError, ValueError) as error:  # from rcl
        return _failed(error)
    if problem and not without_ros:
        return _failed(problem)
    if missing() or not (ros or without_ros):
        return _failed(INSTALL if missing() else NO_ROS)
    logging.basicConfig(level=logging.INFO, format='%(message)s')
    logging.getLogger('websockets').setLevel(logging.ERROR)
    try:
        return asyncio.run(_one_robot(options)) if without_ros else _robots_in_ros(options)
    except (InputError, OSError, RuntimeError, ValueError) as error:
        return _failed(error)


def _failed(error: object) -> int:
    print(f'epson_driver panel: {printable(error)}', file=sys.stderr)
    return 1


def _words() -> tuple[list[str], bool]:
    """Return the command line without ROS arguments, and whether ROS is installed."""
    try:
        from rclpy.utilities import remove_ros_args
    except ModuleNotFoundError:
        return sys.argv[1:], False
    return remove_ros_args(sys.argv)[1:], True


def _check(
    parser: argparse.ArgumentParser, options: argparse.Namespace, *, without_ros: bool
) -> None:
    given = options.program or options.define or options.set
    if given and not (options.simulated and options.program):
        parser.error('--program, --define and --set: need --simulated and --program')
    if not without_ros:
        if options.file:
            parser.error(f'{printable(options.file)}: {SHOWS_DRIVERS}')
        if options.controller:
            parser.error('--controller: needs --simulated or a file')
    elif bool(options.file) == options.simulated:
        parser.error('without ROS, the panel needs robot.yaml or --simulated, and not both')
    elif len(options.robot or ()) > 1:
        parser.error('--robot: without ROS, the panel shows one robot')


class _ShownRobot(Robot):
    """A Robot that opens the panel with the options of the command line."""

    @classmethod
    def running(cls, options: argparse.Namespace, chosen: Mapping[str, str]) -> '_ShownRobot':
        """Return a robot whose simulated controller runs a SPEL+ project."""
        path: Path = options.program
        folder = path if path.is_dir() else path.parent
        names = {'controller': chosen.get('controller'), 'robot': chosen.get('model')}
        settings = read_settings(folder, options.set, **names)
        model = settings.robot or DEFAULT_MODEL
        controller = settings.controller or DEFAULT_CONTROLLER
        words = [f'--program={path}', f'--robot={model}', f'--controller={controller}']
        robot = cls(controller='remote', model=model)
        words += changes_of(options)
        robot._connection.simulation = SimulatedController(words, log=sys.stderr)
        return robot

    async def page(self, options: argparse.Namespace) -> Page:
        from epson_driver.panel.page import show

        return await show(
            self._connection,
            self.points,
            options.host,
            options.port,
            options.trajectory,
            allow_motion=options.allow_motion,
        )


async def _one_robot(options: argparse.Namespace) -> int:
    """Connect to one robot, and show it until a signal ends the command.

    Raises RobotError if the connection fails.
    """
    names = {'controller': options.controller, 'model': (options.robot or [None])[0]}
    chosen = {name: value for name, value in names.items() if value}
    if options.program is not None:
        robot = _ShownRobot.running(options, chosen)
    elif options.simulated:
        robot = _ShownRobot.simulated(**chosen)
    else:
        robot = _ShownRobot(options.file, **chosen)
    stop = asyncio.Event()
    with ended_by_signals(asyncio.get_running_loop(), stop.set):
        async with robot:
            page = await robot.page(options)
            print(f'panel {page.url}', flush=True)
            ends = [asyncio.create_task(event.wait()) for event in (stop, page.ended)]
            await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
    await page.ended.wait()
    return page.code


def _robots_in_ros(options: argparse.Namespace) -> int:
    from epson_driver.panel.access import new_token
    from epson_driver.panel.page import trajectories
    from epson_driver.panel.panel import Panel
    from epson_driver.ros_panel import RosDiscovery

    panel = Panel(
        options.host,
        options.port,
        new_token(options.host),
        partial(RosDiscovery, sys.argv, options.robot),
        trajectories(options.trajectory),
        allow_motion=options.allow_motion,
    )
    for number in ending_signals():
        signal.signal(number, lambda _number, _frame: panel.stop())
    print(f'panel {panel.url}', flush=True)
    return panel.run()


def _robot_file(text: str) -> str:
    if not is_robot_file(text):
        raise argparse.ArgumentTypeError(
            f'{printable(text)}: must be a file written by `epson_driver connect`'
        )
    return text


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        'panel',
        'Show the robots in a browser: 3D view, status, curves, log and buttons.',
        (
            'panel --simulated --robot c4_a601s',
            'panel --simulated --program my_project',
            'panel --port 8081 --robot /left/epson_driver --allow-motion',
            'panel robot.yaml --no-ros --allow-motion',
        ),
        '0 stopped by a signal, 1 cannot start or internal error, 2 invalid arguments',
    )
    parser.add_argument(
        'file',
        nargs='?',
        type=_robot_file,
        metavar='ROBOT.YAML',
        help='file of `epson_driver connect`: connect to this robot, without ROS',
    )
    parser.option('--simulated', 'start and show a simulated robot, without ROS')
    parser.option(
        '--program FOLDER',
        'with --simulated: SPEL+ project that the controller runs, with the settings of its '
        f'{SETTINGS_FILE}',
        Path,
    )
    add_changes(parser)
    parser.option('--no-ros', 'connect to the robot although ROS is there')
    parser.option(
        '--controller PROFILE',
        'controller profile, without ROS (default: from the file, or simulated)',
    )
    parser.option(
        '--host ADDRESS',
        'address to listen on (default: %(default)s). Unless only this machine can reach it, '
        'the page needs the printed token',
        host,
        '127.0.0.1',
    )
    parser.option(
        '--port PORT',
        'port to listen on (0: any free port, default: %(default)s)',
        FREE_PORT,
        PORT,
    )
    parser.option(
        '--robot NODE',
        'driver node, such as /left/epson_driver (repeatable, default: all), or without ROS '
        'the robot model',
        action='append',
    )
    parser.option(
        '--trajectory FILE',
        'JointTrajectory as YAML (repeatable, default: all of this package)',
        Path,
        [],
        action='append',
    )
    parser.option('--allow-motion', 'permission to move real robots')
    return parser
