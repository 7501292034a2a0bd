# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Families of difficult trajectories: plans are found without stops.

Invariant 2 of docs/invariants.md.
"""

from functools import cache

import pytest

from benchmark import families

pytestmark = pytest.mark.invariant(2)


HARD = ('single_joint', 'zigzag', 'near_limits')


@cache
def four_members(name: str) -> families.FamilyFigures:
    """Run four trajectories of a family. Fractions of fewer plans have little meaning."""
    figures = families.run_family(name, range(4))
    assert figures.plans > 50
    return figures


@pytest.mark.slow
@pytest.mark.parametrize('name', HARD)
def test_family_respects_limits_without_stops(name: str) -> None:
    figures = four_members(name)
    assert figures.stops == figures.unfinished == figures.violations == 0
    assert max(figures.velocity, figures.acceleration, figures.jerk) <= 1.0 + 1e-6
    assert figures.outside <= 1e-10
    assert figures.time_ratio <= 1.0, 'never slower than point to point'
    assert 0.0 < figures.commanded_ratio <= 1.2


@pytest.mark.slow
@pytest.mark.parametrize('name', HARD)
def test_at_most_2_percent_of_the_plans_of_a_family_fail(name: str) -> None:
    assert four_members(name).failed_share <= 0.02


@pytest.mark.slow
def test_tiny_steps_do_not_slow_down_a_long_motion() -> None:
    """A start that slow would become a rest at the first point."""
    figures = families.run_family('mixed_sizes', (9003, 109))
    assert 0.0 < figures.commanded_ratio <= 1.1
    assert figures.stops == figures.failed == 0
