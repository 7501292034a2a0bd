# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/reliability.md has the figures of benchmark/results, and says where they come from."""

from benchmark import reliability_page
from benchmark.provenance import provenance

RUN = provenance('make it')
CELL = {
    'fault': 'cut', 'phase': 'moving', 'profile': 'rc620', 'interface': 'usual',
    'end': 'aborted', 'rest': 0.1, 'recovery': 0.2, 'failure': '',
}  # fmt: skip


def test_the_page_has_the_figures_of_the_results() -> None:
    written = reliability_page.PAGE.read_text(encoding='utf-8')
    assert written == reliability_page.page(), 'run `python -m benchmark.reliability_page`'


def test_a_table_of_faults_counts_outcomes_and_names_what_failed() -> None:
    cells = [
        CELL,
        CELL | {'rest': 0.4},
        {'failure': 'AssertionError: moved'} | {key: CELL[key] for key in ('fault', 'phase')},
    ]
    text = ''.join(reliability_page.faults({'run': RUN, 'cells': cells}))
    assert '3 cells; in 1 of them something did not hold.' in text
    assert '`make it`' in text
    assert '| `cut` | moving | 3 | 2 aborted, **failed** | 0.25 … 0.40 | 0.20 … 0.20 |' in text


def test_a_table_of_fuzzing_has_rates_and_sums() -> None:
    target = {'inputs': 1000, 'seconds': 0.5, 'corpus': 7, 'found': ['x']}
    figures = {'run': RUN, 'seed': 1, 'targets': {'one': target, 'two': target}}
    text = ''.join(reliability_page.fuzz(figures))
    assert '| one | 1,000 | 2,000 | 7 | 1 |' in text
    assert '| **together** | 2,000 |' in text
