# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/reliability.md: each table is made of one run, and says of which."""

import json
import os
import platform
import sys
import textwrap
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmark import RESULTS, ROOT


def provenance(command: str) -> dict[str, Any]:
    """Return what is to be known of the run that ends now; `command` repeats it."""
    return {
        'command': command,
        'date': datetime.now(UTC).strftime('%Y-%m-%d'),
        'machine': f'{_processor()}, {os.cpu_count()} cores',
        'python': platform.python_version(),
        'system': platform.system(),
    }


def sentence(data: dict[str, Any]) -> str:
    """Return it in words."""
    return (
        f'`{data["command"]}`, {data["date"]}, {data["machine"]}, {data["system"]}, '
        f'Python {data["python"]}'
    )


def command_of(module: str) -> str:
    """Return the command of this run as a person would type it."""
    return ' '.join(['python -m', module, *sys.argv[1:]])


def _processor() -> str:
    try:
        text = Path('/proc/cpuinfo').read_text(encoding='utf-8')
    except OSError:
        return platform.machine()
    names = [line.partition(':')[2].strip() for line in text.splitlines() if 'model name' in line]
    return names[0] if names else platform.machine()


PAGE = ROOT / 'docs' / 'reliability.md'

FAULTS, SOAK, FUZZ = 'faults.json', 'soak.json', 'fuzz.json'

Figures = dict[str, Any]

NAMES = {'memory': 'memory of the driver', 'controller_memory': 'memory of the controller'}


def write_figures(name: str, figures: Figures, folder: Path = RESULTS) -> None:
    """Write figures to a file; a whole run's make its table of the page anew."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(figures, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / name).write_text(text + '\n', encoding='utf-8')
    if folder == RESULTS:
        PAGE.write_text(page(PAGE.read_text(encoding='utf-8'), name, figures), encoding='utf-8')


def page(text: str, name: str, figures: Figures) -> str:
    """Return the page with the table of a file's figures."""
    mark, lines = PARTS[name]
    begin, end = f'<!-- {mark}: begin -->\n', f'<!-- {mark}: end -->\n'
    head, rest = text.split(begin)
    return head + begin + ''.join(lines(figures)) + end + rest.split(end)[1]


def faults(figures: Figures) -> Iterator[str]:
    """Yield the table of the fault matrix: a row for each fault."""
    cells = figures['cells']
    failed = [cell for cell in cells if cell['failure']]
    yield _text(
        f'{len(cells)} cells; in {len(failed)} of them something did not hold. '
        f'{sentence(figures["run"])}.'
    )
    yield _row('fault', 'cells', 'how the goal ended', 'longest rest [s]', 'longest recovery [s]')
    yield _row('---', '---:', '---', '---:', '---:')
    for fault in dict.fromkeys(cell['fault'] for cell in cells):
        found = [cell for cell in cells if cell['fault'] == fault]
        good = [cell for cell in found if not cell['failure']]
        ends = dict.fromkeys(cell['end'] for cell in good)
        counted = (f'{sum(cell["end"] == end for cell in good)} {end}' for end in ends)
        yield _row(
            f'`{fault}`',
            str(len(found)),
            ', '.join([*counted, *['**failed**'] * (len(good) < len(found))]),
            _longest(cell['rest'] for cell in good),
            _longest(cell['recovery'] for cell in good),
        )


def soak(figures: Figures) -> Iterator[str]:
    """Yield the table of the long run: what was done, and what the process took."""
    yield _text(f'{sentence(figures["run"])}; seed {figures["seed"]}.')
    yield _row('what', 'after the warm-up', 'at the end', 'most')
    yield _row('---', '---:', '---:', '---:')
    for name, unit, digits in (
        ('memory', 'MB', 2),
        ('controller_memory', 'MB', 2),
        ('descriptors', '', 0),
        ('threads', '', 0),
        ('tasks', '', 0),
    ):
        values = figures['flat'][name]
        shown = (f'{values[when]:.{digits}f} {unit}'.strip() for when in ('warm', 'last', 'most'))
        yield _row(NAMES.get(name, name), *shown)
    yield '\n'
    problems = figures['problems']
    goals = f'{figures["minutes"]:.0f} minutes, {figures["goals"]} goals'
    yield f'{goals}; {len(problems)} things did not hold{":" if problems else "."}\n'
    if problems:
        yield '\n'
    for problem in problems:
        yield textwrap.fill(f'* {problem}', 120, subsequent_indent='  ') + '\n'


def fuzz(figures: Figures) -> Iterator[str]:
    """Yield how much was fuzzed, and what was found."""
    targets = figures['targets']
    yield _text(f'{sentence(figures["run"])}; seed {figures["seed"]}.')
    total = sum(target['inputs'] for target in targets.values())
    found = {name: len(target['found']) for name, target in targets.items() if target['found']}
    count = sum(found.values())
    yield f'{total:,} inputs to {len(targets)} targets; {count} things did not hold'
    yield f': {", ".join(f"{name} {each}" for name, each in found.items())}.\n' if found else '.\n'


def _longest(times: Iterator[float]) -> str:
    """Return the longest of some times, s."""
    found = list(times)
    return f'{max(found):.2f}' if found else ''


def _text(words: str) -> str:
    """Return a paragraph."""
    return textwrap.fill(words, 120, break_on_hyphens=False) + '\n\n'


def _row(*cells: str) -> str:
    return f'| {" | ".join(cells)} |\n'


PARTS: dict[str, tuple[str, Callable[[Figures], Iterator[str]]]] = {
    FAULTS: ('faults', faults),
    SOAK: ('soak', soak),
    FUZZ: ('fuzz', fuzz),
}
