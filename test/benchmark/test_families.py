# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Families of trajectories that were hard to plan: plans are found, and the arm does not stop.

Invariant 2 of docs/invariants.md.
"""

import numpy as np
import pytest

from benchmark import families

pytestmark = pytest.mark.invariant(2)


def two_members(name: str, monkeypatch: pytest.MonkeyPatch) -> families.FamilyFigures:
    """Run two trajectories of a family."""
    what, _, make = families.FAMILIES[name]
    monkeypatch.setitem(families.FAMILIES, name, (what, 2, make))
    figures = families.run_family(name)
    assert figures.runs == 2 * len(families.RUNS)
    return figures


@pytest.mark.parametrize('name', ['zigzag', 'single_joint', 'near_limits'])
def test_all_limits_are_kept_and_the_arm_does_not_stop(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = two_members(name, monkeypatch)
    assert figures.stops == figures.unfinished == figures.violations == 0
    assert max(figures.velocity, figures.acceleration, figures.jerk) <= 1.0 + 1e-6
    assert figures.outside <= 1e-10
    assert figures.time_ratio <= 1.0, 'never slower than point to point'


@pytest.mark.parametrize('name', ['zigzag', 'single_joint', 'near_limits'])
def test_plans_are_found(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert two_members(name, monkeypatch).failed_share <= 0.02


@pytest.mark.parametrize('name', families.FAMILIES)
def test_every_member_lies_within_the_position_limits(name: str) -> None:
    for member in families.members(name):
        assert np.all(member.positions >= member.limits.position_min)
        assert np.all(member.positions <= member.limits.position_max)
