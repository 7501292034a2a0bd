# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the planner is asked, and what it answers: data only, so that a process can plan."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.path import Knots
from epson_driver.motion.smoother.time_parametrisation import State, TimeParametrisation


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """What to plan: from a state on a path through knots that are kept, on through points.

    start: when the plan begins, s on the smoother's clock; None if the arm rests until it comes.
    state: u and its derivatives then. kept: the knots that stay, from the one before the state;
    a single one if the path begins here, at rest. older: more of the knots of the path so far, in
    case that no plan is found with fewer. points: positions after the kept knots, shape (m, n).
    clock: when each kept knot and point should be reached, shape (k + m,), s from any time on.
    timed: whether clock counts for the segment before it, shape (k + m,). lag: how late the state
    is on this clock, s. pause: come to rest on the path, wherever that is soon. horizon: how far
    ahead a plan looks at most (nearly), s. urgent: whether a slow plan is better than none.
    former: what the plan so far does from the state on, with all of its knots in `older`.
    whole: whether the trajectory ends at the last of the points.
    catch_up: how many times as fast as commanded the motion may be, to make up for lost time.
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
    """What to do from `start` on (see Request): the path through knots, by the timing.

    The knots are the first ones of the request's kept knots and points.
    proposer: which one found the timing.
    """

    start: float | None
    knots: Knots
    timing: TimeParametrisation
    proposer: str


PASSED_TYPES = (Request, Plan, Knots, TimeParametrisation, JointLimits)
"""What passes between a planner in a process of its own and who asks it."""
