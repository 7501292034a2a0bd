# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Plans do not depend on OpenBLAS's matrix kernel for a processor."""

import os
import subprocess
import sys

import numpy as np
import pytest

OTHER = 'Prescott'
"""A kernel that runs on every x86-64 machine and is never the default."""

PLANS = """
from benchmark.limit_sets import limit_set
from benchmark.trajectories import benchmark_set
from epson_driver.motion import smooth
for trajectory in benchmark_set():
    if trajectory.name in ('sparse_corners', 'moveit_100_percent'):
        motion = smooth(trajectory.positions, limit_set('full'))
        for row in (motion.times, *motion.positions.T):
            print(*(value.hex() for value in row.tolist()))
"""


@pytest.mark.slow
def test_plans_are_equal_under_another_kernel() -> None:
    """docs/smoother.md: the same times, positions within 1e-6 rad."""

    def plans(**variables: str) -> list[list[float]]:
        run = subprocess.run(
            [sys.executable, '-c', PLANS],
            env={**os.environ, 'PYTHONPATH': ':'.join(sys.path), **variables},
            capture_output=True,
            text=True,
            check=True,
        )
        return [[float.fromhex(value) for value in row.split()] for row in run.stdout.splitlines()]

    here, there = plans(), plans(OPENBLAS_CORETYPE=OTHER)
    assert len(here) == 2 * 7
    for row, other in zip(here, there, strict=True):
        np.testing.assert_allclose(other, row, rtol=0.0, atol=1e-6)
