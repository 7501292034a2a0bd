# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver fleet`: simulated robots with their drivers, and a table of how they do."""

import argparse
import tempfile
from contextlib import closing
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from epson_driver.cli.arguments import argument
from epson_driver.fleet.fleet_processes import running_fleet
from epson_driver.fleet.table import say_environment, show, wait
from epson_driver.fleet.watch import Watch
from epson_driver.inputs import count, number, printable
from epson_driver.processes.interrupt import INTERRUPTED, raise_at_first_signal
from epson_driver.processes.processes import RunError

MAX_ROBOTS = 64


def main() -> int:
    """Run until Ctrl-C, or as long as asked for. Returns 0 if all robots were up to the end."""
    arguments = _arguments()
    console = Console()
    raise_at_first_signal()
    up = False
    try:
        with (
            tempfile.TemporaryDirectory(prefix='epson_driver_fleet_') as folder,
            running_fleet(
                Path(folder),
                arguments.robots,
                together=arguments.together,
                server=arguments.discovery == 'server',
            ) as fleet,
            closing(Watch(fleet.names)) as watch,
        ):
            wait(fleet, watch, console)
            say_environment(fleet, console)
            up = True
            return show(fleet, watch, arguments.seconds, console)
    except (RunError, OSError) as error:
        said = f'[bold red]fleet failed:[/] {escape(printable(error))}'
        console.print(said, highlight=False, soft_wrap=True)
        return 1
    except KeyboardInterrupt:
        console.print('all ended')
        return 0 if up else INTERRUPTED


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='epson_driver fleet',
        description='Simulated robots with their drivers in a ROS domain of their own, each in '
        'its namespace, and a table of how they do, until Ctrl-C.',
    )
    parser.add_argument(
        '--robots',
        type=argument(count(1, MAX_ROBOTS)),
        default=4,
        metavar='N',
        help='how many (%(default)s)',
    )
    parser.add_argument(
        '--together',
        action='store_true',
        help='one process for all drivers, not one for each',
    )
    parser.add_argument(
        '--discovery',
        choices=('server', 'simple'),
        default='server',
        help='how they find each other: by a discovery server of Fast DDS, which is started too, '
        'or by asking everybody (%(default)s)',
    )
    parser.add_argument(
        '--seconds',
        type=argument(number(0.1, 1e6, 's')),
        metavar='S',
        help='end by itself after so long (default: at Ctrl-C)',
    )
    return parser.parse_args()
