# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The planner's problem, request and answer, and the plan that is executed.

They are data only, so that a separate process can plan. The computing effort of a plan is counted
instead of timed, so that calls are reproducible. Its unit is 1 µs on one core of a PC of 2024,
estimated from the counts that dominate the time.
"""

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.limit_usage import LimitUsage, limit_usage
from epson_driver.motion.smoother.path import Knots, Path
from epson_driver.motion.smoother.time_parametrisation import State, TimeParametrisation
from epson_driver.motion.smoother.waypoints import Waypoint


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """A planning request: from a state on a path through kept knots, then through points.

    start: start time of the plan, s on the smoother's clock. None: it starts when it arrives, and
    the arm rests until then. state: u and its derivatives at the start. kept: the knots that stay,
    from the knot before the state, or a single one if the path starts there at rest. older: more
    knots of the current path, for a plan that needs them. points: positions after the kept knots,
    shape (m, n). clock: time at which each kept knot and point should be reached, shape (k + m,),
    s with any origin. timed: whether the clock is commanded in the segment before it, shape (k +
    m,). lag: delay of the state on this clock, s. pause: come to rest on the path as soon as
    possible. horizon: approximate maximum planning horizon, s. urgent: whether a slow plan is
    better than none. former: the current plan's timing from the state on, with all of its knots in
    `older`.
    whole: whether the trajectory ends at the last of the points.
    catch_up: maximum ratio to the commanded speed for making up lost time.
    """

    start: float | None
    state: State
    kept: Knots
    older: Knots | None
    points: Array
    clock: Array
    timed: npt.NDArray[np.bool_]
    lag: float
    pause: bool
    horizon: float
    urgent: bool
    former: TimeParametrisation | None = None
    whole: bool = False
    catch_up: float = math.inf


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The motion from `start` (see Request): the path through knots, and the timing.

    The knots are the first ones of the request's kept knots and points.
    proposer: name of the algorithm that found the timing.
    """

    start: float | None
    knots: Knots
    timing: TimeParametrisation
    proposer: str


PASSED_TYPES = (Request, Plan, Knots, TimeParametrisation, JointLimits)
"""Types exchanged between a planner in a separate process and its caller."""


@dataclass(frozen=True, slots=True, eq=False)
class ActivePlan:
    """The plan that is executed from the time `begin`, s: a path, and the timing on it.

    route: the waypoint at each knot of the path. clocks: commanded time of each waypoint, s on the
    clock of the points, shape (k,). pause: whether the plan comes to rest as soon as possible,
    and not at the end of the path.
    """

    path: Path
    timing: TimeParametrisation
    route: list[Waypoint]
    clocks: Array
    begin: float
    pause: bool

    @property
    def end(self) -> float:
        """Time at which the motion comes to rest at the end of the plan, s."""
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


MAX_EFFORT_US = 46_000
"""Maximum effort of a plan, without the constant part for the path and its speed bounds."""

NEWTON_STEP_US, ROW_US = 90, 0.032
"""Cost of a Newton step of `interior_point`, and of each of its rows."""

VERIFICATION_US, PIECE_US = 600, 2.5
"""Cost of the verification of a timing, and of each of its pieces."""

OUTSET_US, ROUND_US = 2_500, 1_500
"""Cost of a path with its speed bounds, and overhead of a round of Newton steps."""


@dataclass(slots=True)
class Effort:
    """The remaining effort, µs."""

    left: float = MAX_EFFORT_US

    @property
    def used_up(self) -> bool:
        """Whether the effort is exhausted."""
        return self.left <= 0.0

    def spend(self, effort: float) -> None:
        """Consume some effort."""
        self.left -= effort


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """A fast motion from `start` to rest at the path's end within commanded speeds and limits.

    commanded: places u, increasing, and the maximum u̇² there (linear between them), shape (c,)
    each, or None: only the limits apply. effort: computing effort available for it.
    """

    path: Path
    start: State
    limits: JointLimits
    commanded: tuple[Array, Array] | None = None
    effort: Effort = field(default_factory=Effort)

    @property
    def end(self) -> float:
        """Position u at which the motion comes to rest."""
        return self.path.end

    def usage(self, timing: TimeParametrisation) -> LimitUsage:
        """Return the usage of the limits by a timing on the path."""
        self.effort.spend(VERIFICATION_US + PIECE_US * len(timing.jerks))
        return limit_usage(self.path, timing, self.limits)

    def fastest(self, first: Array) -> Array:
        """Return the highest u̇ that the velocity limits allow, shape (m,), for q′ of (m, n)."""
        with np.errstate(divide='ignore'):
            bounds: Array = np.min(self.limits.velocity / np.abs(first), axis=1)
        return bounds

    def wanted(self, us: Array, first: Array) -> Array:
        """Return the wanted u̇ at every u, shape (m,), where the path has q′ = `first`."""
        fastest = self.fastest(first)
        if self.commanded is None:
            return fastest
        return np.minimum(fastest, np.sqrt(np.interp(us, *self.commanded)))
