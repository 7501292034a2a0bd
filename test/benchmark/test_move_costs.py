# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The time of a move besides its motion, and of goals at the arm, in virtual time."""

import pytest
from support.api_harness import robot_cell

from benchmark.goals import arm_time, plans
from benchmark.moves import inputs, moves, short_planning
from epson_driver.driver.smoothing import Smoothing


@pytest.mark.parametrize(
    ('profile', 'longest'), [('simulated', 0.09), ('motoman', 0.08), ('remote', 0.1)]
)
async def test_move_costs_little_besides_its_motion(profile, longest, monkeypatch):
    monkeypatch.setattr('benchmark.moves.REPEATS', 2)
    with short_planning():
        async with robot_cell(profile=profile, smooth=True) as (robot, controller):
            times, ratio = await moves(robot, controller)
            assert max(times.values()) < longest, times
            assert ratio <= 1.02 or profile == 'remote'
            assert max((await inputs(robot, controller)).values()) < 0.025


@pytest.mark.slow
async def test_goals_at_half_speed_keep_their_times():
    with short_planning():
        for plan in plans(0.5, 0.1):
            assert 0.98 < await arm_time('simulated', plan, Smoothing()) / plan.duration < 1.03
