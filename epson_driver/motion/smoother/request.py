# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The request to the planner, its plan, and the problem that it solves.

u is the path parameter, u̇ and ü are its time derivatives, and q′ is the derivative of the joint
positions with respect to u.

A separate process can plan, because requests and plans can be pickled. The computing effort of a
plan is not measured, but estimated from the dominant operations, so that plans are reproducible.
The unit of the effort is 1 µs on one core of a PC of 2024.
"""

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.limit_usage import LimitUsage, limit_usage
from epson_driver.motion.smoother.output_guard import Motion
from epson_driver.motion.smoother.path import Knots, Path
from epson_driver.motion.smoother.waypoints import Waypoint
from epson_driver.motion.time_parametrisation import State, TimeParametrisation


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """Request to plan the motion from a state to rest, along k path knots and through m points."""

    start: float | None
    """Start time of the plan on the smoother's clock, s. None: the arm is at rest, and the motion
    starts as soon as the planner has returned the plan."""
    state: State
    """Path parameter u at the start, and its derivatives u̇ and ü."""
    knots: Knots
    """First knots of the path: the current path's knots around `state`, or one knot at rest."""
    current_knots: Knots | None
    """All knots of the current path, from the last knot before `state`. None if the arm is at
    rest, or if the current path includes points beyond this request."""
    points: Array
    """Positions after the knots, shape (m, n), rad."""
    clock: Array
    """Time at which each knot and point should be reached, s, shape (k + m,). The zero of these
    times is arbitrary."""
    timed: npt.NDArray[np.bool_]
    """Whether each time in `clock` is commanded instead of estimated, shape (k + m,)."""
    lag: float
    """Delay of the state relative to `clock`, s."""
    pause: bool
    """Whether to come to rest on the path as soon as possible."""
    horizon: float
    """Approximate maximum duration of the planned motion, s."""
    urgent: bool
    """Whether to accept a plan with a slow motion if no faster plan is found."""
    current_timing: TimeParametrisation | None = None
    """The current plan's timing along `current_knots`, starting at `state`, or None."""
    whole: bool = False
    """Whether the last point of the request is also the end of the trajectory."""
    catch_up: float = math.inf
    """Maximum ratio of the speed to the commanded speed while a motion makes up a delay."""
    in_time: bool = False
    """Whether the parameter of the current path is the commanded time, s."""
    ends: bool = False
    """Whether the last point is, or seems to be, the end of the trajectory."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A motion that begins at `start` (see Request): a path through knots, and the timing on it.

    The knots are the request's knots and points, or only the first of them. proposer: name of the
    algorithm that found the timing.
    """

    start: float | None
    knots: Knots
    timing: TimeParametrisation
    proposer: str
    in_time: bool = False
    """Whether the path parameter is the commanded time, s."""


PASSED_TYPES = (Request, Plan, Knots, TimeParametrisation, JointLimits)
"""Types that a planner in a separate process exchanges with its caller."""


@dataclass(frozen=True, slots=True, eq=False)
class ActivePlan:
    """A plan whose execution starts at the time `start`, s.

    route, clocks: the waypoint at each knot of the path, and the time at which the knot should be
    reached, s. pause: whether the plan comes to rest as soon as possible instead of at the path's
    end.
    """

    path: Path
    timing: TimeParametrisation
    route: list[Waypoint]
    clocks: Array
    start: float
    pause: bool
    in_time: bool = False

    @property
    def end(self) -> float:
        return self.start + self.timing.duration

    @property
    def finished(self) -> bool:
        """Whether the plan ends at a commanded rest that has not been moved since."""
        last = self.route[-1]
        return last.rest is not None and bool(
            np.all(last.position == self.path.knots.position[-1])
        )

    def along(self, times: Array) -> Motion:
        """Return the motion at m times during its execution, shapes (m, n)."""
        u, v, a, _ = (part[:, None] for part in self.timing.sample(times - self.start))
        q, first, second, _ = self.path.sample(u[:, 0])
        return Motion(q, first * v, first * a + second * (v * v))

    def clock(self, time: float) -> float:
        """Return the time at which the position at `time` should be reached, s (see `clocks`)."""
        u, _, _ = self.timing.at(time - self.start)
        return float(np.interp(u, self.path.knots.u, self.clocks))


MAX_EFFORT_US = 46_000

NEWTON_STEP_US, ROW_US = 90, 0.032
"""Fixed effort of a Newton step of `interior_point`, and additional effort per row, µs."""

VERIFICATION_US, PIECE_US = 600, 2.5
"""Fixed effort of verifying a timing, and additional effort per piece, µs."""

OUTSET_US, ROUND_US = 2_500, 1_500
"""Effort of preparing a path and its speed bounds, and fixed effort of a round, µs."""


@dataclass(slots=True)
class Effort:
    left: float = MAX_EFFORT_US

    @property
    def used_up(self) -> bool:
        return self.left <= 0.0

    def spend(self, effort: float) -> None:
        self.left -= effort


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """The planning problem: the fastest motion from the state `start` to rest at the path's end.

    commanded: the speed limit that follows from the commanded times, or None if there are none.
    The limit consists of increasing path parameters u, and the maximum u̇² at each of them.
    Between two of them, the maximum u̇² is interpolated linearly.
    """

    path: Path
    start: State
    limits: JointLimits
    commanded: tuple[Array, Array] | None = None
    effort: Effort = field(default_factory=Effort)

    @property
    def end(self) -> float:
        return self.path.end

    def usage(self, timing: TimeParametrisation) -> LimitUsage:
        self.effort.spend(VERIFICATION_US + PIECE_US * len(timing.jerks))
        return limit_usage(self.path, timing, self.limits)

    def fastest(self, first: Array) -> Array:
        """Return the highest u̇ that the velocity limits allow where q′ is `first`, (m, n)."""
        with np.errstate(divide='ignore'):
            bounds: Array = np.min(self.limits.velocity / np.abs(first), axis=1)
        return bounds

    def target_speeds(self, us: Array, first: Array) -> Array:
        """Return the highest u̇ that the velocity limits and `commanded` allow, shape (m,).

        us: path parameters, shape (m,). first: derivatives q′ of the path at them, shape (m, n).
        """
        fastest = self.fastest(first)
        if self.commanded is None:
            return fastest
        return np.minimum(fastest, np.sqrt(np.interp(us, *self.commanded)))
