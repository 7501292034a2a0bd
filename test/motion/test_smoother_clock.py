# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The smoother follows irregular commanded times, neither early nor late."""

import numpy as np
import pytest
from support.clocks import CLOCKS, clock_errors, clocked, off_the_clock
from support.examples import one_in
from support.smoother_harness import ARM

from benchmark.exact_extrema import Recorded, exact_extrema
from epson_driver.motion.smoother import Mode, Smoother

SEEDS = one_in(3, (101, 100, 102))
SHORT_S = 0.3
RUNS = [(kind, np.inf) for kind in CLOCKS]
RUNS += [(kind, SHORT_S) for kind in CLOCKS if kind != 'irregular']
"""Irregular points are seconds apart, so a short look-ahead has one point only."""


@pytest.mark.parametrize(('kind', 'known'), one_in(6, RUNS, several=True))
@pytest.mark.parametrize('seed', SEEDS)
def test_points_are_passed_near_their_time(kind: str, seed: int, known: float) -> None:
    member = clocked(kind, seed)
    early, late = off_the_clock(member, known)
    assert max(early, late) <= member.tolerance


def stepped(pace: float, catch_up: float) -> tuple[Recorded, float]:
    """Return a smoother after a start from rest, and its maximum speed.

    The speed is a multiple of the commanded one, which is constant.
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
def test_delay_is_caught_up_at_most_at_the_configured_speed(catch_up: float) -> None:
    """A start from rest is late, and stays late with 1. The speed is a cost, no hard bound."""
    smoother, fastest = stepped(2.0, catch_up)
    assert catch_up - 0.1 < fastest <= 1.04 * catch_up
    assert exact_extrema(smoother, np.zeros(6)).worst <= 1.0 + 1e-6
    early, late = clock_errors(smoother)
    assert late >= -early


@pytest.mark.parametrize('catch_up', [0.99, np.nan, -1.0])
def test_invalid_catch_up_is_rejected(catch_up: float) -> None:
    with pytest.raises(ValueError, match=r'catch_up = .*: must be 1 or more'):
        Smoother(ARM, np.zeros(6), catch_up=catch_up)
