# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The problem of the planner: a fast timing from a moving state to rest, on a path.

The computing effort of a plan is counted instead of timed, so that calls are reproducible. Its
unit is 1 µs on one core of a PC of 2024, estimated from the counts that dominate the time.
"""

from dataclasses import dataclass, field

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.limit_usage import LimitUsage, limit_usage
from epson_driver.motion.smoother.path import Path
from epson_driver.motion.smoother.time_parametrisation import State, TimeParametrisation

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
        """Position u of the rest."""
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
