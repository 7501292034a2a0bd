# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The time of goals at the arm, in virtual time."""

import pytest

from benchmark.goals import arm_time, plans
from benchmark.moves import short_planning
from epson_driver.driver.smoothing import Smoothing


@pytest.mark.slow
async def test_goal_at_half_speed_keeps_its_time():
    (plan, *_) = plans(0.5, 0.1)
    with short_planning():
        assert 0.95 < await arm_time('simulated', plan, Smoothing()) / plan.duration < 1.08
