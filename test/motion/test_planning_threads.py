# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Planning in a user's process does not use BLAS threads."""

import subprocess
import sys

import pytest

OWN_THREADS = """
import time
import numpy as np
from benchmark.limit_sets import limit_set
from benchmark.trajectories import benchmark_set
from epson_driver.motion import smooth
from epson_driver.motion.smoother import Mode, Smoother
for trajectory in benchmark_set():
    if trajectory.name not in ('sparse_corners', 'moveit_100_percent'):
        continue
    limits, points = limit_set('full'), trajectory.positions
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


@pytest.mark.slow
def test_planning_uses_only_the_calling_thread() -> None:
    """BLAS threads would busy-wait for more work."""
    run = subprocess.run(
        [sys.executable, '-c', OWN_THREADS],
        env={'PATH': '', 'PYTHONPATH': ':'.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    ratios = [float(line) for line in run.stdout.split()]
    assert len(ratios) == 4
    assert max(ratios) < 1.1
