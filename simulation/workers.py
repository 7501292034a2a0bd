# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Simulated worker processes: the controller's planner, and the driver's smoothing of goals.

They run in the simulation's process, take simulated time, and may hang or exit. The package's own
code starts, monitors and ends them, and encodes their data.
"""

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np

from epson_driver.driver.smoothing import Smoothing
from epson_driver.driver.smoothing_worker import smoothed_trajectory
from epson_driver.motion import JointLimits, Trajectory
from epson_driver.motion.smoother import PASSED_TYPES, plan
from epson_driver.processes.worker import packed, unpacked

STARTS_S = 0.3
PLANS_S = (0.005, 0.012, 0.012, 0.03, 0.15)
"""Planning times, s: mostly as measured (docs/smoother.md), or on a busy machine."""

PREPARES_S = (0.02, 0.1, 0.1, 1.0)
"""Times for smoothing a goal, s."""


class Worker:
    """A replacement for a process with pipes. It is its own stdin."""

    pid = 0

    def __init__(self, work: Callable[[Any], Any], takes: Callable[[], float]) -> None:
        self._work, self._takes = work, takes
        self._loop = asyncio.get_running_loop()
        self._ended: asyncio.Future[int] = self._loop.create_future()
        self.stdin, self.stdout, self.stderr = self, asyncio.StreamReader(), asyncio.StreamReader()
        self.hangs = False

    @property
    def returncode(self) -> int | None:
        """The exit code, or None while it runs."""
        return self._ended.result() if self._ended.done() else None

    def write(self, data: bytes) -> None:
        value = unpacked(data, {*PASSED_TYPES, JointLimits, Trajectory, Smoothing})
        self._loop.call_later(self._takes(), self._answer, packed(self._work(value)))

    def _answer(self, data: bytes) -> None:
        if not self.hangs and not self._ended.done():
            self.stdout.feed_data(data)

    def kill(self) -> None:
        self.end(-9)

    def end(self, code: int) -> None:
        if not self._ended.done():
            self._ended.set_result(code)
            self.stdout.feed_eof()
            self.stderr.feed_eof()

    async def wait(self) -> int:
        return await asyncio.shield(self._ended)


class Workers:
    """Replaces `start_worker`, and stores the last worker of each kind."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._last: dict[str, Worker] = {}

    async def start(self, module: str, _stderr: int | None = None) -> Worker:
        await asyncio.sleep(STARTS_S)
        name = module.rpartition('.')[2].partition('_')[0]
        work, takes = WORKS[name]
        worker = Worker(work(), lambda: float(self._rng.choice(takes)))
        self._last[name] = worker
        return worker

    def last(self, name: str) -> Worker | None:
        """Return the last worker of a kind, `planner` or `smoothing`, or None."""
        return self._last.get(name)


def _planning() -> Callable[[Any], Any]:
    limits: JointLimits | None = None

    def work(value: Any) -> Any:
        nonlocal limits
        if isinstance(value, JointLimits):
            limits = value
            return None
        request, others = value
        limits = others or limits
        assert limits is not None
        return plan(request, limits)

    return work


def _smoothing() -> Callable[[Any], Any]:
    def work(value: Any) -> Any:
        try:
            return smoothed_trajectory(*value)
        except ValueError as error:
            return str(error)

    return work


WORKS = {'planner': (_planning, PLANS_S), 'smoothing': (_smoothing, PREPARES_S)}
