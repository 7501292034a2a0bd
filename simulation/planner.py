# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The process that plans smooth motion, without a process: it takes its time, hangs, and dies.

What starts, watches and restarts it is the controller's own `PlannerProcess`.
"""

import asyncio
from typing import Any

from epson_driver.motion import JointLimits
from epson_driver.motion.smoother import plan
from epson_driver.sim_controller.arm.planner_process import PlannerError

PLANS_S = (0.005, 0.012, 0.012, 0.03, 0.15)
"""How long a plan takes: mostly as measured (docs/smoother.md), and on a busy machine."""

STARTS_S = 0.5


class PlannerChild:
    """Has what `PlannerProcess` asks of its child. `rng` draws how long each plan takes."""

    pid = 0

    def __init__(self, rng: Any) -> None:
        self._rng = rng
        self._limits: JointLimits | None = None
        self._answers: asyncio.Queue[tuple[float, Any]] = asyncio.Queue()
        self._hangs = False
        self.ends: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        """How it has ended."""

    def send(self, value: Any) -> None:
        """Take the limits to begin with, or a request with limits from now on."""
        if isinstance(value, JointLimits):
            self._limits = value
            self._answers.put_nowait((STARTS_S, None))
            return
        request, limits = value
        self._limits = limits or self._limits
        if not self._hangs and not self.ends.done() and self._limits is not None:
            takes = float(self._rng.choice(PLANS_S))
            self._answers.put_nowait((takes, plan(request, self._limits)))

    async def receive(self) -> Any:
        """Return the next answer. Raises PlannerError that says how it has ended."""
        answer = asyncio.create_task(self._answer())
        await asyncio.wait([answer, self.ends], return_when=asyncio.FIRST_COMPLETED)
        if not answer.done():
            answer.cancel()
            raise PlannerError(self.ends.result())
        return answer.result()

    async def _answer(self) -> Any:
        takes, answer = await self._answers.get()
        await asyncio.sleep(takes)
        return answer

    def hang(self) -> None:
        """Answer no more."""
        self._hangs = True

    def kill_hung(self) -> None:
        """End as one that was killed because it did not answer."""
        self.die('did not answer in time')

    def die(self, how: str) -> None:
        """End."""
        if not self.ends.done():
            self.ends.set_result(how)

    async def end(self) -> None:
        """End as told."""
        self.die('was told to end')
