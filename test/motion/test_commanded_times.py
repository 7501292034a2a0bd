# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Speeds along a path that follow from the commanded times."""

import numpy as np
import pytest
from support.smoother_harness import ARM

from epson_driver.motion.limits import Array
from epson_driver.motion.smoother import Mode, Smoother
from epson_driver.motion.smoother.commanded_times import SMOOTHED_S, problem_of
from epson_driver.motion.smoother.path import through
from epson_driver.motion.smoother.request import Effort

PLACES = 20_000
"""Samples per segment for the integral of its duration."""


def commanded(
    positions: Array, durations: list[float | None], factor: float = 1.0
) -> tuple[Array, Array]:
    """Return each planned segment's duration at the commanded speeds, and by the clock, s.

    The clock respects the joint limits.
    """
    smoother = Smoother(ARM, positions[0], Mode.TIME_PRESERVING, planner=None)
    for position, duration in zip(positions[1:], durations, strict=True):
        smoother.append(position, duration)
    smoother.finish()
    request = smoother.request()
    assert request is not None
    path = through(request.knots, request.points, ARM, clamped=False)
    problem = problem_of(request, path, ARM, factor, Effort())
    assert problem.commanded is not None
    spent = []
    for start, end in zip(path.knots.u[:-1], path.knots.u[1:], strict=True):
        us = start + (end - start) * (np.arange(PLACES) + 0.5) / PLACES
        slowness = 1.0 / np.sqrt(np.interp(us, *problem.commanded))
        spent.append(float((end - start) * slowness.mean()))
    return np.array(spent), np.diff(request.clock)


@pytest.mark.parametrize('factor', [1.0, 0.5])
@pytest.mark.parametrize('seed', range(6))
def test_each_knot_is_reached_near_its_time(seed: int, factor: float) -> None:
    rng = np.random.default_rng(seed)
    steps = 10.0 ** rng.uniform(-3.0, -0.5, (8, 1)) * rng.normal(size=(8, 6))
    positions = np.vstack([np.zeros(6), 0.2 * np.cumsum(steps, axis=0)])
    durations = (10.0 ** rng.uniform(-2.0, 0.0, 8)).tolist()
    spent, wanted = commanded(positions, durations, factor)
    assert len(spent) > 2
    missed = np.cumsum(factor * spent - wanted)
    assert np.abs(missed).max() <= SMOOTHED_S + 1e-6
    assert missed[-1] == pytest.approx(0.0, abs=1e-3)


def test_constant_pace_gives_equal_durations() -> None:
    positions = np.zeros((9, 6))
    positions[:, 0] = 0.1 * np.arange(9)
    spent, _ = commanded(positions, [0.2] * 8)
    assert spent == pytest.approx(0.2)


def test_segment_without_a_time_is_as_fast_as_the_limits_allow() -> None:
    """The segments before and after it are slow."""
    positions = np.zeros((4, 6))
    positions[1:, 0] = np.cumsum([0.02, 0.3, 0.02])
    spent, _ = commanded(positions, [1.0, None, 1.0])
    assert spent[1] < 0.01
