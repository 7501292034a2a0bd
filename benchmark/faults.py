# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Effect of every fault on every controller, in every phase of a motion.

`python -m benchmark.faults` runs all cells of test/support/fault_cells.py: real driver, simulated
controller and TCP in virtual time, so its times do not depend on the machine. It prints the table
of docs/reliability.md. Exit code 1 if a check failed. `--only PATTERN` runs the cells whose names
match.
"""

import argparse
import asyncio
import logging
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from support.event_loop import run
from support.fault_cells import Cell, cells
from support.fault_play import play

_log = logging.getLogger(__name__)


def figures_of(cell: Any) -> dict[str, Any]:
    """Run a cell and return its figures, with a failed check in `failure`."""
    known = asdict(cell) | {'failure': ''}

    async def one() -> None:
        known.update(asdict(await play(cell)))

    try:
        run(one())
    except (AssertionError, TimeoutError, asyncio.CancelledError) as error:
        known['failure'] = f'{type(error).__name__}: {error}'
    for name in ('rest', 'recovery'):
        if name in known:
            known[name] = round(known[name], 4)
    return known


def main() -> int:
    """Run the cells. Returns 1 if one failed."""
    parser = argparse.ArgumentParser(prog='benchmark.faults', description=__doc__)
    parser.add_argument('--only', metavar='PATTERN', default='', help='cells whose names match')
    arguments = parser.parse_args()
    logging.disable(logging.CRITICAL)
    chosen: list[Cell] = [cell for cell in cells() if re.search(arguments.only, cell.name)]
    result = []
    for number, cell in enumerate(chosen, 1):
        figures = figures_of(cell)
        result.append(figures)
        if figures['failure'] or arguments.only:
            print(f'{cell.name}: {_shown(figures)}', flush=True)
        elif sys.stdout.isatty():
            print(f'\r{number}/{len(chosen)} {cell.name:40}', end='', flush=True)
    failed = sum(bool(figures['failure']) for figures in result)
    print(f'\n{len(result)} cells, {failed} failed')
    for row in table(result):
        print(f'| {" | ".join(row)} |')
    return int(failed > 0)


def table(cells: list[dict[str, Any]]) -> Iterator[Sequence[str]]:
    """Yield the cells of a Markdown table: a row for each fault."""
    yield 'fault', 'cells', 'how the goal ended', 'longest rest [s]', 'longest recovery [s]'
    yield '---', '---:', '---', '---:', '---:'
    for fault in dict.fromkeys(cell['fault'] for cell in cells):
        result = [cell for cell in cells if cell['fault'] == fault]
        good = [cell for cell in result if not cell['failure']]
        ends = [f'{count} {end}' for end, count in Counter(cell['end'] for cell in good).items()]
        ends += ['**failed**'] * (len(good) < len(result))
        longest = (
            f'{max(cell[time] for cell in good):.2f}' if good else ''
            for time in ('rest', 'recovery')
        )
        yield f'`{fault}`', str(len(result)), ', '.join(ends), *longest


def _shown(figures: dict[str, Any]) -> str:
    if figures['failure']:
        return f'FAILED: {figures["failure"]}'
    return (
        f'{figures["end"]}; rest {figures["rest"]:.2f} s, recovery {figures["recovery"]:.2f} s; '
        f'{figures["text"]}; gate: {figures["gate"]}'
    )


if __name__ == '__main__':
    sys.exit(main())
