# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Random plans with close pairs amid long ways, and the exact extrema of what is executed.

Invariant 2 of docs/invariants.md.
"""

import pytest
from support.smoother_harness import assert_within_all_limits

pytestmark = pytest.mark.invariant(2)

QUICK = 3
"""Plans of `make test`, every tenth sampled at 10 kHz, the others at 1 kHz."""

MORE = 12
"""Those up to here are of `make test-all`."""

BLOCKS, SIZE = 20, 100
"""2,000 plans, sampled likewise, in `make soak`; a block takes a minute."""

SLOW_BLOCKS = 3
"""Those of `make test-all`."""


@pytest.mark.parametrize(
    'first',
    [
        *range(0, QUICK, 3),
        *(pytest.param(first, marks=pytest.mark.slow) for first in range(QUICK, MORE, 3)),
    ],
)
def test_no_limit_is_exceeded_at_any_instant(first: int) -> None:
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
def test_no_limit_is_exceeded_at_any_instant_in_2000_plans(block: int) -> None:
    for seed in range(1000 + SIZE * block, 1000 + SIZE * (block + 1)):
        assert_within_all_limits(seed, 1e-3 if seed % 10 else 1e-4)
