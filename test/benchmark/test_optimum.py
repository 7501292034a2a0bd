# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""ipopt's fastest motion in cases with a known optimum (`make optimum` installs CasADi)."""

import numpy as np
import pytest

from benchmark.limit_sets import limit_set
from benchmark.optimum import MERGED_RAD, merged, optimum
from benchmark.trajectories import BenchmarkTrajectory
from epson_driver.motion import go

LIMITS = limit_set('full')
START = np.array([0.0, 0.0, 0.5, 0.0, -1.0, 0.0])
END = np.array([1.0, -0.5, 1.0, 0.5, -0.5, 1.0])


def test_nearly_equal_points_are_merged() -> None:
    near, middle = 0.9 * MERGED_RAD, (START + END) / 2.0
    points = np.array(
        [START, START + near, middle, middle + near, middle + 2.0 * near, END - near, END]
    )
    np.testing.assert_array_equal(merged(points), points[[0, 2, 4, 6]])


def test_optimum_of_two_points_equals_the_exact_result() -> None:
    pytest.importorskip('casadi', reason='no CasADi (make optimum installs it)')
    exact = go(LIMITS, START, END).duration
    result = optimum(BenchmarkTrajectory('line', np.array([START, END]), None), LIMITS)
    assert result is not None
    assert result.duration == pytest.approx(exact, rel=5e-3)
