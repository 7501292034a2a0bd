# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What benchmark.fleet makes of its figures: files, ratios, and a model of more robots."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmark.fleet_results import Case, Data, Results, expected, report, write

CASE = Case(
    robots=4,
    together=False,
    server=False,
    seen_s=3.0,
    newcomer_s=0.5,
    start_packets=1600,
    start_bytes=800_000,
    newcomer_packets=400.0,
    newcomer_bytes=200_000.0,
    packets_per_s=16.0,
    bytes_per_s=8_000.0,
    start_cpu_s=4.0,
    idle_cores=0.1,
)
CASES = [
    CASE,
    replace(CASE, robots=8, start_packets=6400, start_bytes=3_200_000, bytes_per_s=16_000.0),
    replace(CASE, server=True, start_packets=800, start_bytes=200_000),
]
RESULTS = Results(CASES, [Data(0, 1.0, 100.0), Data(1, 183.0, 60_000.0)])


def test_more_robots_are_on_the_line_through_the_largest_runs() -> None:
    simple = [case for case in CASES if not case.server]
    assert expected(simple, 80, lambda case: case.start_packets) == pytest.approx(640_000)
    assert expected(simple, 80, lambda case: case.bytes_per_s) == pytest.approx(160_000)
    fewer = [*simple, replace(CASE, robots=1, start_packets=7)]
    assert expected(fewer, 80, lambda case: case.start_packets) == pytest.approx(640_000)


def test_the_report_has_ratios_and_says_what_is_a_model() -> None:
    text = report(RESULTS, 'a machine')
    assert '|4|a process each|1.00|0.50|0.25|1.00|1.00|1.00|' in text
    model = text.partition('## More robots')[2]
    assert 'A model' in model
    assert '|100|a process each|simple discovery|1e+06|500.0|200|' in model
    assert 'discovery server' not in model  # of one run alone there is none
    assert '|1|183|60.0|' in text
    assert max(map(len, text.splitlines())) <= 120


def test_robots_that_were_never_heard_of_are_stated() -> None:
    text = report(Results([replace(CASE, unseen=1, newcomer_unseen=2)], []), 'a machine')
    assert '|4|a process each|simple discovery|3.0, 1 never|0.50, 2 never|1600|' in text
    assert 'never' not in report(RESULTS, 'a machine')


def test_the_files_are_written(tmp_path: Path) -> None:
    write(tmp_path, RESULTS)
    stored = json.loads((tmp_path / 'fleet.json').read_text(encoding='utf-8'))
    assert [Case(**each) for each in stored['cases']] == CASES
    assert stored['date']
    assert (tmp_path / 'fleet.png').read_bytes().startswith(b'\x89PNG')
