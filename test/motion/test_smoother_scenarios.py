# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Random plans, streams, holds, stops and replacements: limits at every instant.

Invariants 2 and 3 of docs/invariants.md.
"""

import pytest
from support.examples import one_in
from support.smoother_harness import assert_kept, assert_within_all_limits

pytestmark = pytest.mark.invariant(2, 3)


def blocks(count, slow):
    """Return blocks: `make test-all` runs the first `slow`, and `make soak` the others."""
    marks = [pytest.mark.slow if block < slow else pytest.mark.soak for block in range(count)]
    return [pytest.param(block, marks=mark) for block, mark in enumerate(marks)]


def check_plans(first: int, last: int) -> None:
    """Check random plans, every tenth sampled at 10 kHz, the others at 1 kHz."""
    for seed in range(first, last):
        assert_within_all_limits(seed, 1e-3 if seed % 10 else 1e-4)


def test_limits_hold_at_every_instant_of_a_plan() -> None:
    check_plans(0, 3)


@pytest.mark.timeout(3600)
@pytest.mark.parametrize('block', blocks(40, slow=1))
def test_limits_hold_at_every_instant_in_2000_plans(block: int) -> None:
    check_plans(1000 + 50 * block, 1050 + 50 * block)


@pytest.mark.parametrize('seed', one_in(2, [0, 1]))
def test_limits_hold_at_every_instant_for_any_sequence_of_requests(seed: int) -> None:
    assert_kept(seed)


@pytest.mark.timeout(1800)
@pytest.mark.parametrize('block', blocks(20, slow=1))
def test_limits_hold_at_every_instant_in_500_scenarios(block: int) -> None:
    for seed in range(100 + 25 * block, 125 + 25 * block):
        assert_kept(seed)
