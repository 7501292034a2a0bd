# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What is a target met, and what the tables say."""

import re
from dataclasses import replace

from benchmark.cases import Case
from benchmark.metrics import Metrics
from benchmark.references import ReferenceTimes
from benchmark.tables import report, targets
from benchmark.targets import TARGETS, outcomes

GOOD = Metrics(
    duration=1.05,
    velocity=1.0,
    acceleration=1.0,
    jerk=1.0,
    mismatch=0.0,
    stops=0,
    waypoint=1e-9,
    overrun=0.0,
    end=0.0,
    deviation=0.1,
    outside=0.0,
    step_median=1e-5,
    step_p99=2e-5,
    cycle_p99=1e-3,
)
NAMES = ('T, all known', 'T, 0.5 s known', 'T, 3·A/J known', 'T, 2·A/J known')


def case(**changes: object) -> Case:
    times = ReferenceTimes(8.0, 48, 0.7, 1.0, 1.0, 1.0, 1.0)
    timed = replace(GOOD, duration=2.01)
    made = Case('one', 'a test', 'full', 50, 2.0, 0.0, times)
    made.strategies = {'O, all known': replace(GOOD, **changes), **dict.fromkeys(NAMES, timed)}
    return made


def missed(*cases: Case) -> list[str]:
    return [outcome.metric for outcome in outcomes(list(cases)) if not outcome.met]


def test_what_is_good_meets_every_target() -> None:
    assert missed(case()) == []
    assert all(outcome.moonshot_met for outcome in outcomes([case()]))


def test_each_target_can_be_missed() -> None:
    bad = {
        'T / PTP, 50 points or more, O': {'duration': 2.01},
        'largest velocity / limit': {'velocity': 1.0001},
        'largest acceleration / limit': {'acceleration': 1.0001},
        'largest jerk / limit': {'jerk': 1.021},
        'interior stops that were not commanded, 3·A/J or more known': {'stops': 1},
        'waypoint error beyond merging': {'waypoint': 1.1e-5},
        'overrun past the last known point': {'overrun': 1e-6},
        'distance from the last known point at the end': {'end': 1e-6},
        'v and a against positions, share of limit': {'mismatch': 0.01},
        'outside the position limits': {'outside': 1e-6},
        'step p99 / cycle': {'step_p99': 5e-4},
    }
    for metric, changes in bad.items():
        assert metric in missed(case(), case(**changes)), metric
    assert missed(case(duration=1.36)) == ['T / OPT, O']


def test_a_target_is_judged_only_where_it_applies() -> None:
    slow = case()
    slow.strategies['T, all known'] = replace(GOOD, duration=3.0)
    assert 'T / commanded where that is ≥ 1.5 · OPT, T' in missed(slow)
    slow.commanded = 1.1
    outcome = next(one for one in outcomes([slow]) if one.metric.startswith('T / commanded'))
    assert outcome.worst is None
    assert 'not measured' in targets([outcome])


def test_the_report_has_every_target_and_the_worst_place() -> None:
    text = report([case(jerk=1.5)], [], outcomes([case(jerk=1.5)])).replace(' | ', '|')
    for target in TARGETS:
        assert re.search(rf'(?m)^\| ?{re.escape(target.metric)}\|', text)
    assert '|1.5|one, full, O, all known|' in text
    assert '**NO**' in text
