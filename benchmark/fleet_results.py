# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The figures of benchmark.fleet: as JSON, as tables with ratios, as a picture; a model of more.

What is expected of more robots than were run is the line through the two largest runs of the same
kind on logarithmic scales: a model, no measurement.
"""

import json
import math
import os
import platform
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

WIDTH = 120
MODELLED = (100, 300)
MIN_ROBOTS = 4
"""Of the runs that a model rests on: with one robot there are no pairs."""

SHAPES = {False: 'a process each', True: 'one process'}
DISCOVERIES = {False: 'simple discovery', True: 'discovery server'}


@dataclass(frozen=True)
class Case:
    """So many robots of one shape with one kind of discovery."""

    robots: int
    together: bool
    """One process drives them all; else a process each, each on its host."""
    server: bool
    seen_s: float
    """From the start of all drivers until an observer on another host had heard of each."""
    newcomer_s: float
    """From the moment when a second observer came until it had heard of each."""
    start_packets: int
    start_bytes: int
    """What all hosts had sent when all had heard of each other."""
    newcomer_packets: float
    newcomer_bytes: float
    """What all hosts sent because the second observer came."""
    packets_per_s: float
    bytes_per_s: float
    """What all hosts send later, when nothing happens."""
    start_cpu_s: float
    """CPU time of all drivers until they were heard."""
    idle_cores: float
    """What all drivers take of the cores later."""
    unseen: int = 0
    newcomer_unseen: int = 0
    """Robots that the observers never heard of, though their drivers ran."""

    @property
    def kind(self) -> tuple[bool, bool]:
        """What it is compared by, over the numbers of robots."""
        return self.together, self.server

    def as_dict(self) -> dict[str, Any]:
        """Return the figures, four digits of each."""
        return {
            name: float(f'{value:.4g}') if isinstance(value, float) else value
            for name, value in asdict(self).items()
        }


@dataclass(frozen=True)
class Data:
    """What passes the cable of one robot at so many subscribers to its joint states."""

    subscribers: int
    packets_per_s: float
    bytes_per_s: float


class Results(NamedTuple):
    """All that one run found out."""

    cases: list[Case]
    data: list[Data]


def write(folder: Path, results: Results) -> None:
    """Write fleet.json, fleet.md and fleet.png."""
    folder.mkdir(parents=True, exist_ok=True)
    machine = f'{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}'
    content = {
        'date': datetime.now(UTC).date().isoformat(),
        'machine': machine,
        'cases': [case.as_dict() for case in results.cases],
        'data': [asdict(data) for data in results.data],
    }
    text = json.dumps(content, indent=1)
    (folder / 'fleet.json').write_text(text + '\n', encoding='utf-8')
    (folder / 'fleet.md').write_text(report(results, machine), encoding='utf-8')
    picture(results.cases, folder / 'fleet.png')


def report(results: Results, machine: str) -> str:
    """Return the figures as Markdown."""
    parts = [
        '# How robots find each other',
        textwrap.fill(
            f'Written by `make bench-fleet` ({machine}); docs/fleet.md says what follows from it. '
            'Each driver is on a host of its own, or one process has them all; nobody has a '
            'controller, so what passes is discovery.',
            WIDTH,
        ),
        _measured(results.cases),
    ]
    compared = _compared(results.cases)
    if compared:
        parts += ['## A discovery server, as a ratio to simple discovery', compared]
    if results.data:
        parts += ['## Joint states on the cable of one robot', _data(results.data)]
    modelled = _modelled(results.cases)
    if modelled:
        parts += [
            '## More robots',
            'A model: the line through the two largest runs above, on logarithmic scales.',
            modelled,
        ]
    return '\n\n'.join(parts) + '\n'


def expected(cases: Sequence[Case], robots: int, figure: Callable[[Case], float]) -> float:
    """Return what the two cases with most robots, of one kind, let expect of so many robots."""
    first, last = sorted(cases, key=lambda case: case.robots)[-2:]
    low, high = figure(first), figure(last)
    if low <= 0.0 or high <= 0.0:
        return math.nan
    power = math.log(high / low) / math.log(last.robots / first.robots)
    value: float = high * (robots / last.robots) ** power
    return value


def _kinds(cases: Iterable[Case]) -> dict[tuple[bool, bool], list[Case]]:
    found: dict[tuple[bool, bool], list[Case]] = {}
    for case in sorted(cases, key=lambda case: case.robots):
        found.setdefault(case.kind, []).append(case)
    return found


def _measured(cases: Sequence[Case]) -> str:
    header = [
        'robots',
        'drivers',
        'discovery',
        'all seen, s',
        'newcomer, s',
        'start, packets',
        'MB',
        'newcomer, packets',
        'later, packets/s',
        'kB/s',
        'CPU, s',
    ]
    rows = [
        [
            str(case.robots),
            SHAPES[case.together],
            DISCOVERIES[case.server],
            f'{case.seen_s:.1f}' + _never(case.unseen),
            f'{case.newcomer_s:.2f}' + _never(case.newcomer_unseen),
            str(case.start_packets),
            f'{case.start_bytes / 1e6:.2f}',
            f'{case.newcomer_packets:.0f}',
            f'{case.packets_per_s:.0f}',
            f'{case.bytes_per_s / 1e3:.1f}',
            f'{case.start_cpu_s:.1f}',
        ]
        for case in cases
    ]
    return _table(header, rows)


def _never(unseen: int) -> str:
    return f', {unseen} never' if unseen else ''


def _compared(cases: Sequence[Case]) -> str:
    figures: dict[str, Callable[[Case], float]] = {
        'newcomer sees all': lambda case: case.newcomer_s,
        'packets at start': lambda case: case.start_packets,
        'bytes at start': lambda case: case.start_bytes,
        'newcomer, packets': lambda case: case.newcomer_packets,
        'later, bytes/s': lambda case: case.bytes_per_s,
        'CPU at start': lambda case: case.start_cpu_s,
    }
    by = {(case.robots, case.together, case.server): case for case in cases}
    rows = []
    for (robots, together, server), case in by.items():
        simple = by.get((robots, together, False))
        if server and simple is not None:
            ratios = [
                f'{figure(case) / figure(simple):.2f}' if figure(simple) > 0.0 else '–'
                for figure in figures.values()
            ]
            rows.append([str(robots), SHAPES[together], *ratios])
    return _table(['robots', 'drivers', *figures], rows) if rows else ''


def _data(data: Sequence[Data]) -> str:
    rows = [
        [str(each.subscribers), f'{each.packets_per_s:.0f}', f'{each.bytes_per_s / 1e3:.1f}']
        for each in data
    ]
    return _table(['subscribers on other hosts', 'packets/s', 'kB/s'], rows)


def _modelled(cases: Sequence[Case]) -> str:
    rows = []
    for (together, server), found in _kinds(cases).items():
        found = [case for case in found if case.robots >= MIN_ROBOTS]
        if len({case.robots for case in found}) < 2:
            continue
        for robots in MODELLED:
            size = expected(found, robots, lambda case: case.start_bytes)
            later = expected(found, robots, lambda case: case.bytes_per_s)
            packets = expected(found, robots, lambda case: case.start_packets)
            rows.append(
                [
                    str(robots),
                    SHAPES[together],
                    DISCOVERIES[server],
                    f'{packets:.2g}',
                    f'{size / 1e6:.1f}',
                    f'{later / 1e3:.0f}',
                ]
            )
    header = ['robots', 'drivers', 'discovery', 'packets at start', 'MB at start', 'later, kB/s']
    return _table(header, rows) if rows else ''


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table without spaces beside its bars: it is wide."""
    lines = [header, ['---'] * len(header), *rows]
    return '\n'.join(f'|{"|".join(cells)}|' for cells in lines)


COLOURS = {False: 'tab:red', True: 'tab:blue'}
STYLES = {False: 'o-', True: 's--'}


def picture(cases: Sequence[Case], path: Path) -> None:
    """Draw what discovery costs over the number of robots."""
    import matplotlib as mpl

    mpl.use('Agg')
    import matplotlib.pyplot as plt

    panels: tuple[tuple[str, str, Callable[[Case], float]], ...] = (
        ('Discovery at the start', 'MB, sent by all hosts', lambda case: case.start_bytes / 1e6),
        ('Later, when nothing happens', 'kB/s', lambda case: case.bytes_per_s / 1e3),
        ('Until a newcomer has heard of all', 's', lambda case: case.newcomer_s),
    )
    figure, axes = plt.subplots(1, len(panels), figsize=(13, 4.2), layout='constrained')
    counts = sorted({case.robots for case in cases})
    for panel, (title, unit, value) in zip(axes, panels, strict=True):
        for (together, server), found in _kinds(cases).items():
            panel.plot(
                [case.robots for case in found],
                [value(case) for case in found],
                STYLES[together],
                color=COLOURS[server],
                label=f'{DISCOVERIES[server]}, {SHAPES[together]}',
            )
        panel.set_title(title)
        panel.set_ylabel(unit)
        panel.set_xlabel('robots')
        panel.set_xscale('log', base=2)
        panel.set_yscale('log')
        panel.set_xticks(counts, [str(each) for each in counts])
        panel.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)
