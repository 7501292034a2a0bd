# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Exact extrema of random executed plans with close pairs and long segments.

Invariant 2 of docs/invariants.md.
"""

import pytest
from support.smoother_harness import assert_within_all_limits

pytestmark = pytest.mark.invariant(2)

QUICK = 3
"""Number of plans in `make test`, every tenth sampled at 10 kHz, others at 1 kHz."""

MORE = 12
"""Number of plans in `make test-all`."""

BLOCKS, SIZE = 20, 100
"""Blocks of plans in `make soak`, 2,000 plans. A block takes a minute."""

SLOW_BLOCKS = 3
"""Blocks in `make test-all`."""


@pytest.mark.parametrize(
    'first',
    [
        *range(0, QUICK, 3),
        *(pytest.param(first, marks=pytest.mark.slow) for first in range(QUICK, MORE, 3)),
    ],
)
def test_limits_hold_at_every_instant(first: int) -> None:
    for seed in range(first, first + 3):
        assert_within_all_limits(seed, 1e-3 if seed % 10 else 1e-4)


@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    'block',
    [
        pytest.param(block, marks=pytest.mark.slow if block < SLOW_BLOCKS else pytest.mark.soak)
        for block in range(BLOCKS)
    ],
)
def test_limits_hold_at_every_instant_in_2000_plans(block: int) -> None:
    for seed in range(1000 + SIZE * block, 1000 + SIZE * (block + 1)):
        assert_within_all_limits(seed, 1e-3 if seed % 10 else 1e-4)
