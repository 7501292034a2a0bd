# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver panel`: shows and operates robots in a browser."""

import argparse
import logging
import secrets
import signal
import sys
from pathlib import Path

from rclpy.utilities import remove_ros_args

from epson_driver.cli.arguments import FREE_PORT, argument, help_texts, host, parsed
from epson_driver.inputs import InputError, printable
from epson_driver.motion import Trajectory
from epson_driver.panel import INSTALL, missing
from epson_driver.panel.access import is_loopback
from epson_driver.processes.interrupt import ending_signals
from epson_driver.share import share_path
from epson_driver.trajectory_file import read_trajectory

PORT = 8080

SHOWS_DRIVERS = 'the panel shows the drivers that run: start `epson_driver client` with this file'

TOKEN_BYTES = 24
"""Random bytes in the token of a panel that other machines can reach."""


def main() -> int:
    """Serve the page until SIGINT or SIGTERM, and return 0. Returns 1 if that is impossible."""
    parser = _parser()
    try:
        options = parsed(parser, remove_ros_args(sys.argv)[1:], refused=SHOWS_DRIVERS)
    except (RuntimeError, ValueError) as error:  # from rcl
        print(f'epson_driver panel: {printable(error)}', file=sys.stderr)
        return 1
    if missing():
        print(f'epson_driver panel: {INSTALL}', file=sys.stderr)
        return 1
    logging.basicConfig(level=logging.INFO, format='%(message)s')
    logging.getLogger('websockets').setLevel(logging.ERROR)
    from epson_driver.panel.panel import Panel, address  # here, because it imports websockets
    from epson_driver.panel.web_server import WebServerError

    token = None if is_loopback(options.host) else secrets.token_urlsafe(TOKEN_BYTES)
    try:
        panel = Panel(
            options.host,
            options.port,
            token,
            sys.argv,
            options.robot,
            _trajectories(options.trajectory),
            allow_motion=options.allow_motion,
        )
    except (WebServerError, InputError, OSError, RuntimeError, ValueError) as error:
        print(f'epson_driver panel: {printable(error)}', file=sys.stderr)
        return 1
    for number in ending_signals():
        signal.signal(number, lambda _number, _frame: panel.stop())
    print(f'panel {address(options.host, panel.web.port, token)}', flush=True)
    return panel.run()


def _trajectories(files: list[Path]) -> dict[str, Trajectory]:
    """Return the trajectories in the files by name, by default those of this package."""
    paths = files or sorted(share_path('config', 'trajectories').glob('*.yaml'))
    return {path.stem: read_trajectory(path) for path in paths}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='epson_driver panel',
        **help_texts(
            'Show the robots in a browser: 3D view, status, curves, log and buttons.',
            ('panel', 'panel --port 8081 --robot /left/epson_driver --allow-motion'),
            '0 stopped by a signal, 1 cannot start or internal error, 2 invalid arguments',
        ),
        allow_abbrev=False,
    )
    parser.add_argument(
        '--host',
        type=host,
        default='127.0.0.1',
        metavar='ADDRESS',
        help='address to listen on (default: %(default)s). Unless only this machine can reach it, '
        'the page needs the printed token',
    )
    parser.add_argument(
        '--port',
        type=argument(FREE_PORT),
        default=PORT,
        metavar='PORT',
        help='port to listen on (0: any free port, default: %(default)s)',
    )
    parser.add_argument(
        '--robot',
        action='append',
        metavar='NODE',
        help='driver node, such as /left/epson_driver (repeatable, default: all)',
    )
    parser.add_argument(
        '--trajectory',
        type=Path,
        action='append',
        default=[],
        metavar='FILE',
        help='JointTrajectory as YAML (repeatable, default: all of this package)',
    )
    parser.add_argument(
        '--allow-motion',
        action='store_true',
        help='permission to move real robots',
    )
    return parser
