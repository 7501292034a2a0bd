# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The short form of `make soak-motion`: every kind of episode, and the search for leaks."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmark.soak_motion import WARM_UP_S, Sample, flat, soak

STEADY = Sample(0.0, 0, 80_000_000, 60_000_000, 40, 12, 30)


def run_of(seconds: float = 400.0, **growth: float) -> list[Sample]:
    """Return samples of a run in which figures grow by these amounts in total."""
    return [
        replace(
            STEADY,
            seconds=at,
            **{
                name: getattr(STEADY, name) + int(size * at / seconds)
                for name, size in growth.items()
            },
        )
        for at in (seconds * share / 200.0 for share in range(201))
    ]


@pytest.mark.slow
@pytest.mark.invariant(3, 4, 5, 7)
def test_soak_of_a_minute_has_no_problems(tmp_path: Path) -> None:
    figures = soak(minutes=1.0, seed=1, folder=tmp_path, warm_up=20.0)
    leaks = ('memory', 'controller_memory')  # not distinguishable from the warm-up within a minute
    assert [each for each in figures['problems'] if not each.startswith(leaks)] == []
    assert figures['goals'] > 0


def test_steady_figures_are_no_leak() -> None:
    figures, problems = flat(run_of(), WARM_UP_S)
    assert problems == []
    assert figures['memory'] == {'warm': 80.0, 'last': 80.0, 'most': 80.0}


@pytest.mark.parametrize(
    ('name', 'growth'),
    [
        ('memory', 2e6),
        ('controller_memory', 2e6),
        ('descriptors', 3),
        ('threads', 3),
        ('tasks', 3),
    ],
)
def test_growing_figure_is_reported(name: str, growth: float) -> None:
    (problem,) = flat(run_of(**{name: growth}), WARM_UP_S)[1]
    assert problem.startswith(f'{name}: ')


def test_growth_during_the_warm_up_is_no_leak() -> None:
    warm = [replace(each, memory=10_000_000) for each in run_of() if each.seconds < WARM_UP_S]
    assert flat(warm + run_of()[len(warm) :], WARM_UP_S)[1] == []


def test_too_short_run_is_an_error() -> None:
    with pytest.raises(ValueError, match='samples after the warm-up'):
        flat(run_of()[:5], WARM_UP_S)
