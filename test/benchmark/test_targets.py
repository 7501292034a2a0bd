# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What is a target met, and what the tables say."""

from dataclasses import replace
from pathlib import Path

from benchmark.cases import Case
from benchmark.families import FamilyFigures
from benchmark.metrics import Metrics
from benchmark.references import ReferenceTimes
from benchmark.results_file import REPORT, Results, read, write
from benchmark.tables import report, shortened, targets
from benchmark.targets import TARGETS, outcomes

GOOD = Metrics(
    duration=1.005,
    velocity=1.0,
    acceleration=1.0,
    jerk=1.0,
    mismatch=0.0,
    stops=0,
    waypoint=1e-9,
    early=0.01,
    overrun=0.0,
    end=0.0,
    deviation=0.1,
    outside=0.0,
    step_median=1e-5,
    step_p99=2e-5,
    cycle_p99=1e-3,
)
MISMATCH = 'v, a against positions / limit'
NAMES = (
    'time-preserving, all known',
    'time-preserving, 0.5 s known',
    'time-preserving, 3·A/J known',
    'time-preserving, 2·A/J known',
)


def case(**changes: float) -> Case:
    times = ReferenceTimes(8.0, 48, 0.7, 'ipopt', 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    timed = replace(GOOD, duration=2.01)
    made = Case('one', 'a test', 'full', 50, 2.0, 0.0, times)
    made.strategies = {
        'time-optimal, all known': replace(GOOD, **changes),
        **dict.fromkeys(NAMES, timed),
    }
    return made


def missed(*cases: Case) -> list[str]:
    return [outcome.metric for outcome in outcomes(list(cases)) if not outcome.met]


def test_what_is_good_meets_every_target() -> None:
    assert missed(case()) == []
    assert all(outcome.goal_met for outcome in outcomes([case()]))


def test_each_target_can_be_missed() -> None:
    bad = {
        'time / point to point, time-optimal, 50 points or more': {'duration': 2.01},
        'largest velocity / limit': {'velocity': 1.0001},
        'largest acceleration / limit': {'acceleration': 1.0001},
        'largest jerk / limit': {'jerk': 1.021},
        'stops not commanded, 3·A/J or more known': {'stops': 1},
        'beside a waypoint': {'waypoint': 1.1e-5},
        'overrun past the last known point': {'overrun': 1e-6},
        'distance from the last known point at the end': {'end': 1e-6},
        MISMATCH: {'mismatch': 0.01},
        'outside the position limits': {'outside': 1e-6},
        'cost of a step, p99 / cycle': {'step_p99': 5e-4},
    }
    for metric, changes in bad.items():
        assert metric in missed(case(), case(**changes)), metric
    optimum = 'time / optimum, time-optimal'
    assert missed(*[case()] * 3, case(duration=1.11)) == [f'{optimum}, worst']
    assert missed(*[case(duration=1.05)] * 3) == [f'{optimum}, mean']


def test_a_target_is_judged_only_where_it_applies() -> None:
    slow = case()
    slow.strategies['time-preserving, all known'] = replace(GOOD, duration=3.0)
    assert 'time / commanded, time-preserving, where commanded ≥ 1.5 · optimum' in missed(slow)
    slow.strategies['time-preserving, all known'] = replace(GOOD, duration=2.0, early=0.06)
    assert len(missed(slow)) == 1
    slow.commanded = 1.1
    outcome = next(one for one in outcomes([slow]) if one.metric.startswith('time / commanded'))
    assert outcome.worst is None
    assert 'not measured' in targets([outcome])


def test_the_report_has_every_target_and_the_worst_place() -> None:
    text = report([case(jerk=1.5)], outcomes([case(jerk=1.5)]))
    for target in TARGETS:
        assert f'|{shortened(target.metric)}|' in text.replace(' | ', '|').replace('| ', '|')
    assert '|1.5|one, full, fastest, all|' in text.replace(' | ', '|')
    assert '**MISSED**' in text


def test_figures_are_read_as_they_were_written(tmp_path: Path) -> None:
    cases = [case(), case(jerk=1.5)]
    families = [FamilyFigures('zigzag', runs=3, plans=10)]
    write(tmp_path, Results(cases, outcomes(cases), families))
    results = read(tmp_path)  # six digits of each
    assert results.cases == cases
    write(tmp_path, results)
    assert read(tmp_path) == results
    assert (tmp_path / REPORT).read_text(encoding='utf-8') == report(*results)
    assert (tmp_path / 'overview.png').stat().st_size > 10_000
