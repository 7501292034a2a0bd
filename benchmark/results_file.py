# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The benchmark's figures in a file, and the report and the pictures that are made of it."""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.cases import Case, CutStream
from benchmark.families import FamilyFigures
from benchmark.metrics import Metrics
from benchmark.references import ReferenceTimes
from benchmark.tables import report
from benchmark.targets import Outcome
from epson_driver.motion.motion_figures import Figures

FIGURES, REPORT = 'motion.json', 'motion.md'


class Results(NamedTuple):
    """All that one run of the benchmark found out."""

    cases: list[Case]
    outcomes: list[Outcome]
    families: list[FamilyFigures]


def write(folder: Path, results: Results) -> None:
    """Write the figures, and what is made of them."""
    folder.mkdir(parents=True, exist_ok=True)
    data = {
        'cases': [case.as_dict() for case in results.cases],
        'targets': [asdict(outcome) for outcome in results.outcomes],
        'families': [figures.as_dict() for figures in results.families],
    }
    text = json.dumps(rounded(data), indent=1, ensure_ascii=False, allow_nan=False)
    (folder / FIGURES).write_text(text + '\n', encoding='utf-8')
    render(folder)


def render(folder: Path) -> None:
    """Write the report and the pictures of the figures that are there."""
    from benchmark import pictures  # here, so that reading the figures needs no matplotlib

    results = read(folder)
    (folder / REPORT).write_text(report(*results), encoding='utf-8')
    pictures.overview(results.cases, folder / 'overview.png')


def read(folder: Path) -> Results:
    """Return the figures of a folder: six digits of each, as they were written."""
    data = json.loads((folder / FIGURES).read_text(encoding='utf-8'))
    return Results(
        [_case(case) for case in data['cases']],
        [
            Outcome(**outcome | {name: _bound(outcome[name]) for name in ('required', 'goal')})
            for outcome in data['targets']
        ],
        [FamilyFigures(**figures) for figures in data.get('families', [])],
    )


def _case(data: dict[str, Any]) -> Case:
    return Case(
        **data
        | {
            'references': ReferenceTimes(**data['references']),
            'splines': {name: Figures(**use) for name, use in data['splines'].items()},
            'strategies': {name: Metrics(**run) for name, run in data['strategies'].items()},
            'cut_streams': [
                CutStream(**cut | {'metrics': Metrics(**cut['metrics'])})
                for cut in data['cut_streams']
            ],
        }
    )


def _bound(value: float | None) -> float:
    return math.inf if value is None else value


def rounded(value: object) -> object:
    """Return the same with numbers of six digits, and null for what is not finite."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(item) for item in value]
    if isinstance(value, float):
        return float(f'{value:.6g}') if math.isfinite(value) else None
    return value
