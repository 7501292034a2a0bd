# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver fleet`: so many simulated robots with their drivers, and how they do."""

import argparse
import os
import signal
import tempfile
import time
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import NamedTuple, NoReturn

from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from epson_driver.cli import process_figures
from epson_driver.cli.arguments import argument
from epson_driver.cli.fleet_processes import Fleet, running_fleet
from epson_driver.cli.fleet_watch import Seen, Watch
from epson_driver.cli.interrupt import INTERRUPTED
from epson_driver.cli.process_figures import NOTHING, Use
from epson_driver.cli.processes import Process, RunError
from epson_driver.inputs import count, number, printable

MAX_ROBOTS = 64
WINDOW_S = 2.0
"""What the table shows is the mean of so long, s."""

START_TIMEOUT_S = 300.0
"""On a machine with too few cores each robot takes two seconds of one to start."""

SIGNALS = (signal.SIGINT, signal.SIGTERM)
EMPTY = '–'


class Row(NamedTuple):
    """One robot, as the table shows it."""

    name: str
    ended: int | None
    """The exit code of its driver, or of its controller, if that has ended; None: both run."""
    seen: Seen
    driver: Use
    """CPU in shares of a core, memory in bytes; nothing if all robots share one process."""
    controller: Use


def main() -> int:
    """Run until Ctrl-C, or as long as asked for. Returns 0 if all robots were up to the end."""
    arguments = _arguments()
    console = Console()
    for each in SIGNALS:  # SIGINT too: a shell's `&` passes it on ignored
        signal.signal(each, _on_signal)
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
            _wait(fleet, watch, console)
            _say_environment(fleet, console)
            up = True
            return _show(fleet, watch, arguments.seconds, console)
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


def _on_signal(_number: int, _frame: object) -> NoReturn:
    """Leave, and ignore further signals, so that what was started is always ended."""
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    raise KeyboardInterrupt


def _wait(fleet: Fleet, watch: Watch, console: Console) -> None:
    """Wait until every driver has its controller and is heard. Raises RunError."""
    began = time.monotonic()
    total = len(fleet.names)
    with console.status('') as status:
        while len(connected := watch.connected()) < total:
            status.update(f'{len(connected)} of {total} robots are up')
            for each in _processes(fleet):
                each.check_alive()
            if time.monotonic() > began + START_TIMEOUT_S:
                silent = sorted(set(fleet.names) - set(connected))
                said = f'not heard within {START_TIMEOUT_S:g} s'
                raise RunError(f'{", ".join(silent)}: {said}')
            watch.spin(0.1)
    shape = 'one process' if fleet.together else 'a process each'
    lasted = time.monotonic() - began
    robots = 'robot is' if total == 1 else 'robots are'
    console.print(f'{total} {robots} up ({shape}) after {lasted:.1f} s', highlight=False)


def _processes(fleet: Fleet) -> list[Process]:
    """Return every process once."""
    server = [] if fleet.server is None else [fleet.server]
    return list(dict.fromkeys([*fleet.drivers.values(), *fleet.controllers.values(), *server]))


def _say_environment(fleet: Fleet, console: Console) -> None:
    console.print('they go on until Ctrl-C; in another terminal:')
    for name, value in fleet.environment.items():
        console.print(f'export {name}={value}', highlight=False)
    if fleet.server is not None:  # else a tool hears of nothing but what it subscribes to
        console.print('export ROS_SUPER_CLIENT=TRUE  # for ros2 topic list and the like')


def _show(fleet: Fleet, watch: Watch, seconds: float | None, console: Console) -> int:
    """Show how the robots do: on a terminal all the time, else the first time and the last.

    Returns 0 at the end of the time, s, if they are all up then, else 1.
    """
    until = None if seconds is None else time.monotonic() + seconds
    first = True
    terminal = console.is_terminal
    with Live(console=console, auto_refresh=False, transient=not terminal) as live:
        while True:
            rows, others = _window(fleet, watch)
            shown = table(rows, others)
            done = until is not None and time.monotonic() >= until
            if terminal:
                live.update(shown, refresh=True)
            elif first or done:
                console.print(shown)
            if done:
                return 0 if all(is_up(row) for row in rows) else 1
            first = False


def _window(fleet: Fleet, watch: Watch) -> tuple[list[Row], dict[str, Use]]:
    """Return a row for each robot, and what all else of the fleet takes, of the next seconds."""
    own = {f'driver {name}': each for name, each in fleet.drivers.items() if not fleet.together}
    own |= {f'controller {name}': each for name, each in fleet.controllers.items()}
    others: dict[str, int] = {}
    if fleet.together:
        others['drivers, one process'] = next(iter(fleet.drivers.values())).process_id
    if fleet.server is not None:
        others['discovery server'] = fleet.server.process_id
    others['this table'] = os.getpid()
    ids = {name: each.process_id for name, each in own.items()} | others
    before, began = _uses(ids), time.monotonic()
    for name, driver in fleet.drivers.items():
        if driver.returncode is not None:
            watch.forget(name)
    seen = watch.hear(WINDOW_S)
    after, lasted = _uses(ids), time.monotonic() - began
    rates = {
        name: Use(max(after[name].cpu_s - before[name].cpu_s, 0.0) / lasted, used.memory_bytes)
        for name, used in after.items()
    }
    rows = []
    for name in fleet.names:
        codes = [fleet.drivers[name].returncode, fleet.controllers[name].returncode]
        ended = next((code for code in codes if code is not None), None)
        driver_use = rates.get(f'driver {name}', NOTHING)
        rows.append(Row(name, ended, seen[name], driver_use, rates[f'controller {name}']))
    return rows, {name: rates[name] for name in others}


def _uses(ids: dict[str, int]) -> dict[str, Use]:
    if not process_figures.available():
        return dict.fromkeys(ids, NOTHING)
    own = os.getpid()  # its child processes are the others
    return {name: process_figures.use(each, children=each != own) for name, each in ids.items()}


def is_up(row: Row) -> bool:
    """Return whether a robot's processes run, it is connected, answers, and sends its state."""
    seen = row.seen
    connected = seen.link == 'connected' and seen.answer_s is not None
    return row.ended is None and connected and seen.rate > 0.0


def table(rows: Iterable[Row], others: dict[str, Use]) -> Table:
    """Return what a person reads: a line for each robot, for what they share, and for all."""
    rows = list(rows)
    shown = Table(show_footer=True, highlight=False)
    total = sum((row.driver + row.controller for row in rows), NOTHING)
    total = sum(others.values(), total)
    answers = [row.seen.answer_s for row in rows if row.seen.answer_s is not None]
    slowest = min((row.seen.rate for row in rows), default=0.0)
    footers = (
        ('robot', 'all'),
        ('up', f'{sum(map(is_up, rows))} of {len(rows)}'),
        ('link', ''),
        ('answers within', _milliseconds(max(answers, default=None))),
        ('joint states', f'≥ {slowest:.0f} Hz'),
        ('CPU driver', _cores(sum(row.driver.cpu_s for row in rows))),
        ('CPU controller', _cores(sum(row.controller.cpu_s for row in rows))),
        ('CPU', _cores(total.cpu_s)),
        ('memory', _megabytes(total.memory_bytes)),
    )
    for index, (title, footer) in enumerate(footers):
        shown.add_column(title, footer, justify='left' if index < 3 else 'right')
    for row in rows:
        both = row.driver + row.controller
        shown.add_row(
            row.name,
            _state(row),
            row.seen.link or EMPTY,
            _milliseconds(row.seen.answer_s),
            f'{row.seen.rate:.0f} Hz',
            _cores(row.driver.cpu_s),
            _cores(row.controller.cpu_s),
            _cores(both.cpu_s),
            _megabytes(both.memory_bytes),
        )
    for name, used in others.items():
        empty = [''] * 6
        shown.add_row(name, *empty, _cores(used.cpu_s), _megabytes(used.memory_bytes), style='dim')
    return shown


def _state(row: Row) -> str:
    if row.ended is not None:
        return f'[bold red]ended with {row.ended}[/]'
    return '[green]yes[/]' if is_up(row) else '[bold red]no[/]'


def _milliseconds(seconds: float | None) -> str:
    return EMPTY if seconds is None else f'{seconds * 1e3:.0f} ms'


def _cores(share: float) -> str:
    return f'{share * 100:.0f} %' if share else EMPTY


def _megabytes(size: int) -> str:
    return f'{size / 1e6:.0f} MB' if size else EMPTY
