# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The short form of `make soak-motion`: every kind of episode, and the search for leaks."""

from pathlib import Path

import pytest

from benchmark.soak_motion import Sample, flat, soak


@pytest.mark.parametrize(
    ('tasks', 'leaks'),
    [
        ([17] * 14 + [19] * 6, False),  # a command is being executed
        ([17] * 3 + [16] + [17] * 16, False),  # a link is down
        ([17] * 10 + [18] * 10, True),
        ([17] * 9 + [18, 19] + [18] * 9, True),
    ],
)
def test_leak_raises_minimum_and_maximum_of_a_count(tasks: list[int], leaks: bool) -> None:
    samples = [Sample(float(at), 0, 0, 0, 22, 13, count) for at, count in enumerate(tasks)]
    assert bool(flat(samples, warm_up=0.0)[1]) is leaks


@pytest.mark.slow
@pytest.mark.invariant(3, 4, 5, 7)
def test_soak_of_a_minute_has_no_problems(tmp_path: Path) -> None:
    figures = soak(minutes=1.0, seed=1, folder=tmp_path, warm_up=20.0)
    leaks = ('memory', 'controller_memory')  # not distinguishable from the warm-up within a minute
    assert [figure for figure in figures['problems'] if not figure.startswith(leaks)] == []
    assert figures['goals'] > 0
