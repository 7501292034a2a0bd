# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Commanded times are kept however irregular they are: too early is as wrong as too late."""

import numpy as np
import pytest
from support.clocks import CLOCKS, clock_errors, clocked, off_the_clock
from support.examples import one_in
from support.smoother_harness import ARM

from benchmark.exact_extrema import Recorded, exact_extrema
from epson_driver.motion.smoother import Mode, Smoother

SEEDS = one_in(3, (101, 100, 102))
LITTLE_S = 0.3
RUNS = [(kind, np.inf) for kind in CLOCKS]
RUNS += [(kind, LITTLE_S) for kind in CLOCKS if kind != 'irregular']
"""Where points are seconds apart, little is one point: it does not tell how the motion goes on."""


@pytest.mark.parametrize(('kind', 'known'), one_in(6, RUNS, several=True))
@pytest.mark.parametrize('seed', SEEDS)
def test_no_point_is_passed_much_before_or_after_its_time(
    kind: str, seed: int, known: float
) -> None:
    member = clocked(kind, seed)
    early, late = off_the_clock(member, known)
    assert max(early, late) <= member.tolerance


def stepped(pace: float, catch_up: float) -> tuple[Recorded, float]:
    """Return a smoother that stood for a while on its way, and its highest pace after that.

    In times of the commanded one, which is even.
    """
    smoother = Recorded(ARM, np.zeros(6), Mode.TIME_PRESERVING, catch_up=catch_up)
    for number in range(1, 60):
        smoother.append(np.full(6, 0.015 * number), 0.015 / pace)
    smoother.finish()
    fastest = 0.0
    while smoother.moving:
        motion = smoother.step(0.002)
        fastest = max(fastest, float(motion.velocity[0]) / pace)
    return smoother, fastest


@pytest.mark.parametrize('catch_up', [1.0, 1.2])
def test_what_is_late_is_made_up_for_no_faster_than_is_asked_for(catch_up: float) -> None:
    """A start from rest is late, and with 1 stays so; the speeds are costs, and no hard bounds."""
    smoother, fastest = stepped(2.0, catch_up)
    assert catch_up - 0.1 < fastest <= 1.04 * catch_up
    assert exact_extrema(smoother, np.zeros(6)).worst <= 1.0 + 1e-6
    early, late = clock_errors(smoother)
    assert late >= -early


@pytest.mark.parametrize('catch_up', [0.99, np.nan, -1.0])
def test_a_wrong_bound_is_refused(catch_up: float) -> None:
    with pytest.raises(ValueError, match=r'catch_up = .*: must be 1 or more'):
        Smoother(ARM, np.zeros(6), catch_up=catch_up)
