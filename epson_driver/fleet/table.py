# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Wait for the robots of a fleet, and show how they do: a table with a line for each."""

import os
import time
from collections.abc import Iterable
from typing import NamedTuple

from rich.box import SIMPLE
from rich.console import Console
from rich.live import Live
from rich.table import Table

from epson_driver.fleet.fleet_processes import Fleet
from epson_driver.fleet.watch import Seen, Watch
from epson_driver.processes import process_figures
from epson_driver.processes.process_figures import NOTHING, Use
from epson_driver.processes.processes import Process, RunError

START_TIMEOUT_S = 300.0
"""On a machine with too few cores each robot takes two seconds of one to start."""

WINDOW_S = 2.0
"""What the table shows is the mean of so long, s."""

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


def is_up(row: Row) -> bool:
    """Return whether a robot's processes run, it is connected, answers, and sends its state."""
    seen = row.seen
    connected = seen.link == 'connected' and seen.answer_s is not None
    return row.ended is None and connected and seen.rate > 0.0


def table(rows: Iterable[Row], others: dict[str, Use]) -> Table:
    """Return the table: a line for each robot, for shared processes, and for all."""
    rows = list(rows)
    shown = Table(box=SIMPLE, show_footer=True, padding=(0, 1, 0, 0), show_edge=False)
    total = sum((row.driver + row.controller for row in rows), NOTHING)
    total = sum(others.values(), total)
    answers = [row.seen.answer_s for row in rows if row.seen.answer_s is not None]
    slowest = min((row.seen.rate for row in rows), default=0.0)
    footers = (
        ('robot', 'all'),
        ('up', f'{sum(map(is_up, rows))} of {len(rows)}'),
        ('answers', _milliseconds(max(answers, default=None))),
        ('states', f'≥ {slowest:.0f} Hz'),
        ('driver', _cores(sum(row.driver.cpu_s for row in rows))),
        ('controller', _cores(sum(row.controller.cpu_s for row in rows))),
        ('CPU', _cores(total.cpu_s)),
        ('memory', _megabytes(total.memory_bytes)),
    )
    for index, (title, footer) in enumerate(footers):
        shown.add_column(title, footer, justify='left' if index < 2 else 'right')
    for row in rows:
        both = row.driver + row.controller
        shown.add_row(
            row.name,
            _state(row),
            _milliseconds(row.seen.answer_s),
            f'{row.seen.rate:.0f} Hz',
            _cores(row.driver.cpu_s),
            _cores(row.controller.cpu_s),
            _cores(both.cpu_s),
            _megabytes(both.memory_bytes),
        )
    for name, used in others.items():
        empty = [''] * 5
        shown.add_row(name, *empty, _cores(used.cpu_s), _megabytes(used.memory_bytes), style='dim')
    return shown


def _state(row: Row) -> str:
    if row.ended is not None:
        return f'[bold red]ended: {row.ended}[/]'
    if is_up(row):
        return '[green]yes[/]'
    link = row.seen.link.replace('_', ' ') or EMPTY
    return f'[bold red]{"no" if link == "connected" else link}[/]'


def _milliseconds(seconds: float | None) -> str:
    return EMPTY if seconds is None else f'{seconds * 1e3:.0f} ms'


def _cores(share: float) -> str:
    return f'{share * 100:.0f} %' if share else EMPTY


def _megabytes(size: int) -> str:
    return f'{size / 1e6:.0f} MB' if size else EMPTY


def wait(fleet: Fleet, watch: Watch, console: Console) -> None:
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


def say_environment(fleet: Fleet, console: Console) -> None:
    """Print the environment with which another terminal finds the robots."""
    console.print('they go on until Ctrl-C; in another terminal:')
    for name, value in fleet.environment.items():
        console.print(f'export {name}={value}', highlight=False)
    if fleet.server is not None:  # else a tool hears of nothing but what it subscribes to
        console.print('export ROS_SUPER_CLIENT=TRUE  # for ros2 topic list and the like')


def show(fleet: Fleet, watch: Watch, seconds: float | None, console: Console) -> int:
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
    """Return a row for each robot, and the use of shared processes, over the next seconds."""
    own = {f'driver {name}': each for name, each in fleet.drivers.items() if not fleet.together}
    own |= {f'controller {name}': each for name, each in fleet.controllers.items()}
    others: dict[str, int] = {}
    if fleet.together:
        others['drivers'] = next(iter(fleet.drivers.values())).process_id
    if fleet.server is not None:
        others['discovery'] = fleet.server.process_id
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
