# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the smoother keeps: the points ahead, the plan it executes, the one it asked for."""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion.limits import Array
from epson_driver.motion.smoother.path import Path
from epson_driver.motion.smoother.planner import Request
from epson_driver.motion.smoother.time_parametrisation import TimeParametrisation


@dataclass(slots=True, eq=False)
class Point:
    """A point that the motion goes through.

    index counts them. anchor: where the first of the points merged into it was. position: where
    to go, the anchor, or the last of the merged points if nothing follows. clock: when it should
    be reached, s. timed: whether its clock comes from a duration. rest: how long to rest there, s;
    None to go on. tiny: the way there from rest is shorter than the merge tolerance.
    """

    index: int
    anchor: Array
    position: Array
    clock: float = 0.0
    timed: bool = False
    rest: float | None = None
    tiny: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ActivePlan:
    """What is executed since `begin`: a timing on a path whose knots are the points of `route`."""

    path: Path
    timing: TimeParametrisation
    route: list[Point]
    clocks: Array
    begin: float
    scale: float

    @property
    def end(self) -> float:
        """When it rests, s."""
        return self.begin + self.timing.duration

    @property
    def finished(self) -> bool:
        """Whether it ends at a rest, which has not been moved since by a point that was merged."""
        last = self.route[-1]
        return last.rest is not None and bool(
            np.all(last.position == self.path.knots.position[-1])
        )

    def clock(self, time: float) -> float:
        """Return when the motion of a time should be, s on the clock of the points."""
        return float(
            np.interp(self.timing.at(time - self.begin)[0], self.path.knots.u, self.clocks)
        )


@dataclass(frozen=True, slots=True, eq=False)
class PendingRequest:
    """A request, the points that its knots are, and whether there are more behind them."""

    request: Request
    route: list[Point]
    more: bool
