# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Speed scaling in the driver's own smoother, while a goal that it resampled is executed.

1. At another factor the points that were not sent yet are replaced by those of the same motion at
   that share of its speed, after a ramp inside all limits. What is due before the smoother answers
   goes out as it was.
2. They come a block at a time. The last of them is where the goal ends, at a time that is guessed
   until the block with the end is there.
3. At 0 the arm comes to rest on its way, and goes on from there.
4. No more is sent ahead of the clock than the controller needs (lead.py): so soon it acts.
"""

import asyncio
from math import ceil

import numpy as np

from epson_driver.driver.delivery.delivery import Delivery
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.reference import PointSchedule, SpeedScaling
from epson_driver.driver.smoothing import Remainder, SmoothMotion
from epson_driver.motion import Array, Trajectory

ANSWER_S = 0.1
"""What is due in this time goes out before another speed, s: an answer rarely takes as long."""

RESERVE_S = 0.3
"""The next block is asked for when less than this is known beyond what was sent, s."""


class Rescaling:
    """Changes the speed of a goal from `start`, shape (n,), rad, that executes a smooth motion."""

    def __init__(
        self,
        motion: SmoothMotion,
        execution: GoalExecution,
        scaling: SpeedScaling,
        delivery: Delivery,
        start: Array,
    ) -> None:
        self._motion = motion
        self._execution = execution
        self._scaling = scaling
        self._delivery = delivery
        self._start = start
        self._samples = motion.trajectory
        self._reserve = ceil(RESERVE_S / motion.period)
        self._share = 1.0
        self._index = 0
        """The sample that the smoother was asked for last."""
        self._changed = False
        self._goes_on = False
        """Whether more samples follow on those that are known."""
        self._news = asyncio.Event()
        """A point was sent, or another factor asked for."""
        execution.on_sent = scaling.on_set = self._news.set

    async def run(self) -> None:
        """Keep what was not sent at the factor of the moment, until it is cancelled.

        Raises SmoothingError.
        """
        while (schedule := self._execution.schedule) is not None:
            self._news.clear()
            share = self._scaling.target
            if share != self._share:
                begun = schedule.count > schedule.scaled_from
                schedule.hold(ANSWER_S if begun else 0.0)
                await self._replan(schedule, schedule.known, share)
            elif self._goes_on and schedule.known - schedule.count < self._reserve:
                await self._replan(schedule, schedule.count, share)
            elif not self._changed:
                await self._keep_up(schedule)
            await self._news.wait()

    async def _keep_up(self, schedule: PointSchedule) -> None:
        """Have the smoother go where the points are, so that it need not when that is urgent."""
        index = schedule.count - schedule.scaled_from
        if index - self._index >= self._reserve:
            await self._motion.after(index, None)
            self._index = index

    async def _replan(self, schedule: PointSchedule, count: int, share: float) -> None:
        """Replace the points after `count` of them."""
        self._index = max(count - schedule.scaled_from, self._index)
        remainder = await self._motion.after(self._index, share)
        if self._execution.schedule is not schedule:
            return
        self._share, self._changed = share, True
        self._samples = self._joined(remainder)
        prepared = self._delivery.prepare(self._samples, self._start)
        known = len(prepared.messages)
        if remainder.left:
            known -= 1
        velocities = remainder.samples.velocities
        rests = share == 0.0 and velocities is not None and not velocities[-1].any()
        self._goes_on = remainder.left > 0.0 and not rests
        now = asyncio.get_running_loop().time()
        self._execution.go_on_with(prepared.trajectory, prepared.messages, known, now)

    def _joined(self, remainder: Remainder) -> Trajectory:
        """Return the samples so far, those of a remainder, and the end if it comes later."""
        before, after = self._samples, remainder.samples
        last = [] if not remainder.left else [-1]
        end = [after.duration + remainder.left] * len(last)
        parts = (before.positions, after.positions), (before.velocities, after.velocities)
        positions, velocities = (
            np.concatenate([known[: self._index], new, known[last]])
            for known, new in parts
            if known is not None and new is not None
        )
        times = np.concatenate([before.times[: self._index], after.times, end])
        return Trajectory(before.joint_names, times, positions, velocities)
