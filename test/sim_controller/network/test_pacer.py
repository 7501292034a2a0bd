# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The times at which the simulated controller is stepped."""

import asyncio
from types import SimpleNamespace

from epson_driver.sim_controller.core import CYCLE_PERIOD_S
from epson_driver.sim_controller.network.pacer import Pacer


def moving(steps, timer=None):
    """A controller in motion, which appends each step to `steps`, and its next timer, s."""
    return SimpleNamespace(
        in_motion=True,
        step=steps.append,
        timing=SimpleNamespace(deadline_misses=0),
        clock=SimpleNamespace(now=0.0, next_due=timer),
    )


async def test_arm_is_stepped_by_frequent_timers_alone():
    short = 0.6 * CYCLE_PERIOD_S
    for timer, period in ((None, CYCLE_PERIOD_S), (short, short)):
        steps = []
        running = asyncio.create_task(Pacer(moving(steps, timer)).run())
        await asyncio.sleep(20.5 * CYCLE_PERIOD_S)
        running.cancel()
        assert abs(len(steps) - 20.5 * CYCLE_PERIOD_S / period) <= 1


async def test_only_steps_that_are_late_by_a_cycle_are_counted():
    now, controller = [0.0], moving([])
    pacer = Pacer(controller, lambda: now[0])
    missed = []
    for elapsed in (0.0, 1.9, 1.9, 2.1, 1.0):
        now[0] += elapsed * CYCLE_PERIOD_S
        with pacer.present():
            missed.append(controller.timing.deadline_misses)
    assert missed == [0, 0, 0, 1, 1]
