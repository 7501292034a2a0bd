# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A plan with its start time and its waypoints."""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion.limits import Array
from epson_driver.motion.smoother.path import Path
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation
from epson_driver.motion.smoother.waypoints import Waypoint


@dataclass(frozen=True, slots=True, eq=False)
class ActivePlan:
    """The plan executed since `begin`, s: a path, and the timing on it.

    route: the waypoints at the path's knots. clocks: commanded time of each one, s on the clock
    of the points, shape (k,). pause: whether it comes to rest on the path.
    """

    path: Path
    timing: TimeParametrisation
    route: list[Waypoint]
    clocks: Array
    begin: float
    pause: bool

    @property
    def end(self) -> float:
        """Time of the rest at its end, s."""
        return self.begin + self.timing.duration

    @property
    def finished(self) -> bool:
        """Whether it ends at a commanded rest that no merged point has moved since."""
        last = self.route[-1]
        return last.rest is not None and bool(
            np.all(last.position == self.path.knots.position[-1])
        )

    def clock(self, time: float) -> float:
        """Return the commanded time of the position at `time`, s on the clock of the points."""
        u, _, _ = self.timing.at(time - self.begin)
        return float(np.interp(u, self.path.knots.u, self.clocks))
