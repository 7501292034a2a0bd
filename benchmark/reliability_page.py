# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/reliability.md: its tables are made of the figures in benchmark/results.

`python -m benchmark.reliability_page` writes them again; a test compares them. Each part of the
page is made of one file; a file that is not there leaves its part empty.
"""

import json
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import Any

from benchmark.provenance import sentence

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / 'benchmark' / 'results'
PAGE = ROOT / 'docs' / 'reliability.md'

FAULTS, SOAK, FUZZ = 'faults.json', 'soak.json', 'fuzz.json'

Figures = dict[str, Any]

NAMES = {'memory': 'memory of the driver', 'controller_memory': 'memory of the controller'}


def write_figures(name: str, figures: Figures, folder: Path = RESULTS) -> None:
    """Write figures to a file of the results; the page is written anew if it is of them."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(figures, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / name).write_text(text + '\n', encoding='utf-8')
    if folder == RESULTS:
        PAGE.write_text(page(), encoding='utf-8')


def page() -> str:
    """Return the page as it should be."""
    text = PAGE.read_text(encoding='utf-8')
    for mark, (name, lines) in PARTS.items():
        begin, end = f'<!-- {mark}: begin -->\n', f'<!-- {mark}: end -->\n'
        head, rest = text.split(begin)
        path = RESULTS / name
        made: list[str] = []
        if path.exists():
            made = list(lines(json.loads(path.read_text(encoding='utf-8'))))
        text = head + begin + ''.join(made) + end + rest.split(end)[1]
    return text


def faults(figures: Figures) -> Iterator[str]:
    """Yield the table of the fault matrix: a row for each fault and phase."""
    cells = figures['cells']
    failed = [cell for cell in cells if cell['failure']]
    yield _text(
        f'{len(cells)} cells; in {len(failed)} of them something did not hold. '
        f'{sentence(figures["run"])}.'
    )
    yield _row('fault', 'phase', 'cells', 'how the goal ended', 'rest [s]', 'recovery [s]')
    yield _row('---', '---', '---:', '---', '---:', '---:')
    names = list(dict.fromkeys((cell['fault'], cell['phase']) for cell in cells))
    shown = ''
    for fault, phase in sorted(names, key=lambda name: _first(cells, name[0])):
        found = [cell for cell in cells if (cell['fault'], cell['phase']) == (fault, phase)]
        good = [cell for cell in found if not cell['failure']]
        ends = dict.fromkeys(cell['end'] for cell in good)
        counted = (f'{sum(cell["end"] == end for cell in good)} {end}' for end in ends)
        named = '' if fault == shown else f'`{fault}`'
        shown = fault
        yield _row(
            named,
            phase,
            str(len(found)),
            ', '.join([*counted, *['**failed**'] * (len(good) < len(found))]),
            _spread(cell['rest'] for cell in good),
            _spread(cell['recovery'] for cell in good),
        )


def _first(cells: list[Figures], fault: str) -> int:
    return [cell['fault'] for cell in cells].index(fault)


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
    yield _row('what happened', 'times', 'outcomes of the goals')
    yield _row('---', '---:', '---')
    for name, outcomes in figures['episodes'].items():
        told = ', '.join(f'{count} {outcome}' for outcome, count in sorted(outcomes.items()))
        yield _row(name, str(sum(outcomes.values())), told)
    yield '\n'
    problems = figures['problems']
    goals = f'{figures["minutes"]:.0f} minutes, {figures["goals"]} goals'
    yield f'{goals}; {len(problems)} things did not hold{":" if problems else "."}\n'
    if problems:
        yield '\n'
    for problem in problems:
        yield textwrap.fill(f'* {problem}', 120, subsequent_indent='  ') + '\n'


def fuzz(figures: Figures) -> Iterator[str]:
    """Yield the table of what was fuzzed: inputs, how many a second, and what was found."""
    yield _text(f'{sentence(figures["run"])}; seed {figures["seed"]}.')
    yield _row('what', 'inputs', 'inputs/s', 'kept in the corpus', 'found')
    yield _row('---', '---:', '---:', '---:', '---:')
    for name, target in figures['targets'].items():
        rate = target['inputs'] / max(target['seconds'], 1e-9)
        yield _row(
            name,
            f'{target["inputs"]:,}',
            f'{rate:,.0f}',
            str(target['corpus']),
            str(len(target['found'])),
        )
    total = sum(target['inputs'] for target in figures['targets'].values())
    yield _row('**together**', f'{total:,}', '', '', '')


def _spread(values: Iterator[float]) -> str:
    """Return median and most, s."""
    found = list(values)
    return f'{median(found):.2f} … {max(found):.2f}' if found else ''


def _text(words: str) -> str:
    """Return a paragraph."""
    return textwrap.fill(words, 120, break_on_hyphens=False) + '\n\n'


def _row(*cells: str) -> str:
    return f'| {" | ".join(cells)} |\n'


PARTS: dict[str, tuple[str, Callable[[Figures], Iterator[str]]]] = {
    'faults': (FAULTS, faults),
    'soak': (SOAK, soak),
    'fuzz': (FUZZ, fuzz),
}

if __name__ == '__main__':
    PAGE.write_text(page(), encoding='utf-8')
