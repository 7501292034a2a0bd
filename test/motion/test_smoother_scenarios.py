# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Trajectories, streams, holds, stops and replacements in random order.

Invariants 2 and 3 of docs/invariants.md.
"""

import pytest
from support.examples import one_in
from support.smoother_harness import assert_kept

pytestmark = pytest.mark.invariant(2, 3)

BLOCKS, SIZE = 10, 50
"""Blocks of scenarios in `make soak-tests`, 500 in all."""

SLOW_BLOCKS = 2
"""Blocks in `make test-all`."""


@pytest.mark.parametrize('seed', one_in(2, [0, 1]))
def test_limits_hold_at_every_instant_for_any_sequence_of_requests(seed: int) -> None:
    assert_kept(seed)


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    'block',
    [
        pytest.param(block, marks=pytest.mark.slow if block < SLOW_BLOCKS else pytest.mark.soak)
        for block in range(BLOCKS)
    ],
)
def test_limits_hold_at_every_instant_in_500_scenarios(block: int) -> None:
    for seed in range(100 + SIZE * block, 100 + SIZE * (block + 1)):
        assert_kept(seed)
