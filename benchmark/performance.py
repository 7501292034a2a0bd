# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the driver costs beside programs that do the least: state path, motion path, codec.

Part of `make bench`. Ratios of what was measured side by side, each against what is required: the
medians of three runs. Writes performance.json, performance.md and performance.png to
build/benchmark, and the newest figures into docs/reliability.md (--quick: one run, to
build/performance, and the docs stay).
Exit code 0, unless --check is given and a required value is missed. Linux only.
"""

import argparse
import json
import os
import platform
import shutil
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmark import (
    RESULTS,
    ROOT,
    codec,
    goal_length,
    motion_path,
    point_round_trip,
    state_path,
)
from benchmark.performance_report import Bar, docs_page, medians, picture, report
from benchmark.results_file import rounded

DOCS = ROOT / 'docs' / 'reliability.md'
COMMAND = 'make bench'
MIN_DOWNLOAD_SPEED_UP = 50.0
MAX_GROWTH = 1.5
"""Of what must not grow with the length of a goal: the rest is noise."""


@dataclass(frozen=True)
class Machine:
    """Where and when it was measured. load: of the last minute, at the begin and at the end."""

    processor: str
    cores: int
    python: str
    date: str
    command: str
    load: tuple[float, float]
    took: float


def measure(*, quick: bool) -> dict[str, Any]:
    """Return all figures, as JSON has them."""
    began, load = time.monotonic(), os.getloadavg()[0]
    _say('codec')
    codecs, dribble = codec.measure(quick=quick)
    _say('goals of all lengths')
    lengths = goal_length.measure(quick=quick)
    _say('round trips of a point')
    round_trips = point_round_trip.measure(quick=quick)
    _say('state path')
    state = state_path.measure(quick=quick)
    _say('motion path')
    motion = motion_path.measure(quick=quick)
    figures: dict[str, Any] = {
        'codec': [asdict(row) | {'ratio': row.ratio} for row in codecs],
        'dribble': asdict(dribble),
        'goal_length': [asdict(row) for row in lengths],
        'round_trips': asdict(round_trips),
        'state': asdict(state),
        'motion': asdict(motion),
    }
    figures['bars'] = [asdict(bar) for bar in bars(figures)]
    took = time.monotonic() - began
    machine = Machine(
        _processor(),
        os.cpu_count() or 0,
        platform.python_version(),
        time.strftime('%Y-%m-%d'),
        COMMAND + (' ARGS=--quick' if quick else ''),
        (load, os.getloadavg()[0]),
        took,
    )
    return {'machine': asdict(machine), **figures}


def measure_again(runs: int, *, quick: bool) -> dict[str, Any]:
    """Return the figures of the last of some runs, with the medians of what is required."""
    all_runs = [measure(quick=quick) for _ in range(runs)]
    data = all_runs[-1]
    found = medians([[Bar.read(bar) for bar in each['bars']] for each in all_runs])
    machine = data['machine']
    machine['load'] = (all_runs[0]['machine']['load'][0], machine['load'][1])
    machine['took'] = sum(each['machine']['took'] for each in all_runs)
    return data | {'bars': [asdict(bar) for bar in found]}


def bars(figures: dict[str, Any]) -> Iterator[Bar]:
    """Yield what is required, with what was found."""
    for rate in figures['state']['rates']:
        where = f'state at {rate["rate"]:g} Hz'
        yield Bar(f'{where}, byte to subscriber, p50', rate['p50_ratio'], 1.10)
        yield Bar(f'{where}, byte to subscriber, p99', rate['p99_ratio'], 1.25)
        yield Bar(f'{where}, CPU per message', rate['cpu_ratio'], 1.20)
    trips = figures['round_trips']
    yield Bar('round trip of a point, link', trips['link_ratio'], 1.30)
    yield Bar('round trip of a point, goal', trips['goal_ratio'], 1.30)
    download = figures['motion']['download']
    speed_up = motion_path.THESIS_DEAD_TIME_S / download['movement']
    yield Bar(
        'download of 1000 points, thesis to ours', speed_up, MIN_DOWNLOAD_SPEED_UP, at_least=True
    )
    worst = max(figures['codec'], key=lambda row: float(row['ratio']))
    yield Bar(f'codec, the worst ({worst["name"]})', worst['ratio'], codec.MAX_RATIO)
    lengths = {row['points']: row for row in figures['goal_length']}
    long, longest = lengths[10_000], lengths[100_000]
    yield Bar(
        'checked goal to first point, 100,000 points to 10',
        longest['first'] / lengths[10]['first'],
        MAX_GROWTH,
    )
    # less than 10,000 need less: no block of them is full
    yield Bar(
        'memory for checks and it, 100,000 to 10,000',
        longest['memory'] / long['memory'],
        MAX_GROWTH,
    )


def write(folder: Path, data: dict[str, Any]) -> None:
    """Write the figures, the tables and the picture."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / 'performance.json').write_text(text + '\n', encoding='utf-8')
    (folder / 'performance.md').write_text(report(data), encoding='utf-8')
    picture(data, folder / 'performance.png')
    if folder == RESULTS:  # docs keep the picture of the newest whole run
        shutil.copy(folder / 'performance.png', ROOT / 'docs' / 'images')


def _say(what: str) -> None:
    print(f'{what} ...', file=sys.stderr, flush=True)


def _processor() -> str:
    for line in Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines():
        if line.startswith('model name'):
            return line.partition(':')[2].strip()
    return platform.machine()


def main() -> int:
    """Measure, write and print."""
    parser = argparse.ArgumentParser(prog='benchmark.performance', description=__doc__)
    parser.add_argument('--quick', action='store_true', help='a minute; the results stay')
    parser.add_argument('--check', action='store_true', help='a missed bar is an error')
    parser.add_argument('--runs', type=int, metavar='N', help='3, or 1 with --quick')
    arguments = parser.parse_args()
    runs = arguments.runs or (1 if arguments.quick else 3)
    data: Any = rounded(measure_again(runs, quick=arguments.quick))
    if arguments.quick:
        write(ROOT / 'build' / 'performance', data)
    else:
        write(RESULTS, data)
        page = DOCS.read_text(encoding='utf-8')
        DOCS.write_text(docs_page(page, data), encoding='utf-8')
    print(report(data))
    missed = [bar for bar in map(Bar.read, data['bars']) if not bar.met]
    return 1 if arguments.check and missed else 0


if __name__ == '__main__':
    sys.exit(main())
