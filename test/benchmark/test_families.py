# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Families of trajectories that were hard to plan: plans are found, and the arm does not stop.

Invariant 2 of docs/invariants.md.
"""

from functools import cache

import numpy as np
import pytest

from benchmark import families, family_members

pytestmark = pytest.mark.invariant(2)


HARD = ('single_joint', 'zigzag', 'near_limits')


@cache
def four_members(name: str) -> families.FamilyFigures:
    """Run four trajectories of a family: of fewer plans a share says little."""
    figures = families.run_family(name, range(4))
    assert figures.runs == 12
    assert figures.plans > 50
    return figures


@pytest.mark.slow
@pytest.mark.parametrize('name', HARD)
def test_all_limits_are_kept_and_the_arm_does_not_stop(name: str) -> None:
    figures = four_members(name)
    assert figures.stops == figures.unfinished == figures.violations == 0
    assert max(figures.velocity, figures.acceleration, figures.jerk) <= 1.0 + 1e-6
    assert figures.outside <= 1e-10
    assert figures.time_ratio <= 1.0, 'never slower than point to point'
    assert 0.0 < figures.commanded_ratio <= 1.2


@pytest.mark.slow
@pytest.mark.parametrize('name', HARD)
def test_plans_are_found(name: str) -> None:
    assert four_members(name).failed_share <= 0.02


@pytest.mark.slow
def test_time_that_steps_too_small_for_theirs_take_is_made_up_for() -> None:
    """Also by a motion that is a little early before them."""
    figures = families.run_family('mixed_sizes', (9003, 9005))
    assert 0.0 < figures.commanded_ratio <= 1.2
    assert figures.stops == figures.failed == 0


@pytest.mark.slow
def test_a_long_way_between_steps_of_a_milliradian_is_not_taken_at_their_pace() -> None:
    """A start so slow was given up for a rest at the first point."""
    figures = families.run_family('mixed_sizes', (9003, 109))
    assert 0.0 < figures.commanded_ratio <= 1.1
    assert figures.stops == figures.failed == 0


@pytest.mark.parametrize('name', family_members.FAMILIES)
def test_every_member_lies_within_the_position_limits(name: str) -> None:
    for member in family_members.members(name):
        assert np.all(member.positions >= member.limits.position_min)
        assert np.all(member.positions <= member.limits.position_max)
