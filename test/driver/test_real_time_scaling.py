# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Speed scaling during real-time motion, at the targets that the controller takes."""

import asyncio

import numpy as np
import pytest
from support.event_loop import now
from support.rtmc_cell import MODEL, goal, rtmc_cell, usage

from epson_driver.driver.outcome import End

SPEED = 0.4  # rad/s


class Taken:
    """The joints that a controller takes in its cycles."""

    def __init__(self, controller):
        self.times, self.joints = [], []
        motion = controller.real_time.motion
        take = motion.take_target

        def recorded():
            problem = take()
            self.times.append(now())
            self.joints.append(motion.position.copy())
            return problem

        motion.take_target = recorded

    def speed(self, start, end):
        """Return the speeds of joint 1 from `start` to `end`, rad/s, and their times."""
        times, positions = np.array(self.times), np.array(self.joints)[:, 0]
        inside = (times[1:] >= start) & (times[1:] <= end)
        return (np.diff(positions) / np.diff(times))[inside], times[1:][inside]


@pytest.mark.invariant(2, 10)
@pytest.mark.parametrize('factor', [0.01, 0.1, 0.5, 0.9])
async def test_inv10_running_motion_slows_down_and_accelerates_within_50_ms(monkeypatch, factor):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        taken, queue, errors = Taken(cell.controller), harness.driver.goal_queue, []
        line = np.arange(0.0, 2.01, 0.05)[1:, None] * np.eye(6)[0]
        running = goal(harness, *line, step=0.05 / SPEED)

        def compare(execution, sample):
            if execution.desired is not None:
                errors.append(execution.desired[1][0] - sample.positions[0])

        running.handle.on_feedback = compare
        await asyncio.sleep(2.0)
        for before, after in ((1.0, factor), (factor, 1.0)):
            asked, change = now(), (after - before) * SPEED
            queue.set_speed(after)
            await asyncio.sleep(0.5)
            speeds, times = taken.speed(asked, asked + 0.5)
            begun = times[np.abs(speeds - before * SPEED) > 0.05 * abs(change)][0]
            assert begun - asked <= 0.05
            settled = speeds[times > asked + 0.2]
            np.testing.assert_allclose(settled, after * SPEED, atol=0.02 * SPEED)
        outcome = await running.end()
        assert outcome.end is End.SUCCEEDED, outcome.text
        assert max(usage(taken.joints, MODEL.limits)) <= 1.0 + 1e-6
        assert np.ptp(errors) < 0.05  # the plan's clock slows down as the arm does
        assert queue.last_timing.executed == pytest.approx(queue.last_timing.planned, abs=0.3)
