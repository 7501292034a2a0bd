# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Planning in a process of a user: no BLAS threads, and no effect of the matrix kernel."""

import os
import subprocess
import sys

import numpy as np
import pytest

PREFIX = """
import time
from benchmark.limit_sets import limit_set
from benchmark.trajectories import benchmark_set
from epson_driver.motion import smooth
from epson_driver.motion.smoother import Mode, Smoother
limits = limit_set('full')
for trajectory in benchmark_set():
    if trajectory.name not in ('sparse_corners', 'moveit_100_percent'):
        continue
    points = trajectory.positions
"""

PLANS = """
    motion = smooth(points, limits)
    for row in (motion.times, *motion.positions.T):
        print(*(value.hex() for value in row.tolist()))
"""

THREADS = """
    smoother = Smoother(limits, points[0], Mode.TIME_OPTIMAL)
    for point in points[1:]:
        smoother.append(point)
    smoother.finish()
    for planned in (lambda: smoother.step(0.0), lambda: smooth(points, limits)):
        started, of_this = time.process_time(), time.thread_time()
        planned()
        used = time.thread_time() - of_this
        print((time.process_time() - started) / used)
"""


def lines(script: str, variables: dict[str, str]) -> list[str]:
    """Return the output of a script in a new process with these environment variables."""
    run = subprocess.run(
        [sys.executable, '-c', PREFIX + script],
        env=variables | {'PYTHONPATH': ':'.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.splitlines()


@pytest.mark.slow
def test_plans_are_equal_with_another_linear_algebra_kernel() -> None:
    """docs/smoother.md: the same times, positions within 1e-6 rad."""

    def plans(**variables: str) -> list[list[float]]:
        rows = lines(PLANS, {**os.environ, **variables})
        return [[float.fromhex(value) for value in row.split()] for row in rows]

    # Prescott runs on every x86-64 machine and is never the default
    here, there = plans(), plans(OPENBLAS_CORETYPE='Prescott')
    assert len(here) == 2 * 7
    for row, other in zip(here, there, strict=True):
        np.testing.assert_allclose(other, row, rtol=0.0, atol=1e-6)


@pytest.mark.slow
def test_planning_uses_only_the_calling_thread() -> None:
    """BLAS threads would busy-wait for more work."""
    ratios = [float(line) for line in lines(THREADS, {'PATH': ''})]
    assert len(ratios) == 4
    assert max(ratios) < 1.1
