# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""epson_driver's smoother as the benchmark runs it: the plans it makes are counted."""

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.smoother import Mode, Smoother
from epson_driver.motion.smoother.planner import plan
from epson_driver.motion.smoother.request import Plan, Request


class DriverSmoother:
    """As `benchmark.strategies.Smoother`."""

    def __init__(
        self,
        limits: JointLimits,
        start: Array,
        timed: bool,
        latency: float,
        *,
        refine: bool = True,
    ) -> None:
        mode = Mode.TIME_PRESERVING if timed else Mode.TIME_OPTIMAL
        self.plans = 0
        self._smoother = Smoother(
            limits, start, mode, latency=latency, planner=self._plan, refine=refine
        )
        self.append = self._smoother.append
        self.finish = self._smoother.finish
        self.step = self._smoother.step

    @property
    def moving(self) -> bool:
        """Whether the arm moves or has points to go to."""
        return self._smoother.moving

    @property
    def look_ahead(self) -> float:
        """How much is known ahead, s."""
        return self._smoother.look_ahead

    def _plan(self, request: Request, limits: JointLimits) -> Plan | None:
        self.plans += 1
        return plan(request, limits)
