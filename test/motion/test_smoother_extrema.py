# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Random plans with close pairs amid long ways, and the exact extrema of what is executed.

Invariant 2 of docs/invariants.md.
"""

import pytest
from support.smoother_harness import exact_extrema, random_run, sampled_extrema

pytestmark = pytest.mark.invariant(2)

QUICK = 12
"""Plans of `make test`, every tenth sampled at 10 kHz, the others at 1 kHz."""

BLOCKS, SIZE = 20, 100
"""2,000 plans, sampled likewise, in `make soak`; a block takes a minute."""

SLOW_BLOCKS = 3
"""Those of `make test-all`."""


def assert_within_all_limits(seed: int, dt: float) -> None:
    run = random_run(seed, dt)
    exact, sampled = exact_extrema(run), sampled_extrema(run)
    what = f'seed {seed}: {exact}; sampled every {dt} s: {sampled}'
    assert exact.worst <= 1.0 + 1e-6, what
    assert exact.outside <= 1e-10, what
    assert exact.position_jump <= 1e-11, what
    assert exact.velocity_jump <= 1e-8, what
    assert exact.acceleration_jump <= 1e-4, what  # a start that is taken back within 1 µs
    assert sampled.worst <= 1.0 + 1e-4, what
    assert sampled.outside <= 1e-10, what
    assert run.smoother.violations == 0, what


@pytest.mark.parametrize('first', range(0, QUICK, 3))
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
