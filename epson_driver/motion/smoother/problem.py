# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a proposer is asked: a fast timing from a moving state to rest, on a path."""

from dataclasses import dataclass, field

import numpy as np

from epson_driver.motion.limits import Array, JointLimits
from epson_driver.motion.smoother.effort import PIECE_US, VERIFICATION_US, Effort
from epson_driver.motion.smoother.limit_usage import LimitUsage, limit_usage
from epson_driver.motion.smoother.path import Path
from epson_driver.motion.smoother.time_parametrisation import State, TimeParametrisation

SLOWING_SLACK_SHARE = 0.02
"""How much faster than `slowing` a motion may be, relative."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """From `start` to rest at the path's end, as fast as the speeds and the limits allow.

    commanded: places u, increasing, and the most that u̇² should be there (linear between them),
    shape (c,) each; None where only the limits count. slowing: a stop from the start: no speed
    below the stop's is asked for, so that a start that is too fast for `commanded` has time.
    effort: what may be computed for it. former: what the plan so far does from the start on, if
    there is one: to search from.
    """

    path: Path
    start: State
    limits: JointLimits
    commanded: tuple[Array, Array] | None = None
    slowing: TimeParametrisation | None = None
    effort: Effort = field(default_factory=Effort)
    former: TimeParametrisation | None = None

    @property
    def end(self) -> float:
        """The u to rest at."""
        return self.path.end

    def usage(self, timing: TimeParametrisation) -> LimitUsage:
        """Return how much of the limits a timing on the path uses."""
        self.effort.spend(VERIFICATION_US + PIECE_US * len(timing.jerks))
        return limit_usage(self.path, timing, self.limits)

    def fastest(self, first: Array) -> Array:
        """Return the highest u̇ that the velocity limits allow, shape (m,), for q′ of (m, n)."""
        with np.errstate(divide='ignore'):
            bounds: Array = np.min(self.limits.velocity / np.abs(first), axis=1)
        return bounds

    def wanted(self, us: Array, first: Array) -> Array:
        """Return u̇ as it is asked for at every u, shape (m,), where the path has q′ = `first`."""
        fastest = self.fastest(first)
        if self.commanded is None:
            return fastest
        return np.minimum(fastest, np.sqrt(np.interp(us, *self.commanded)))

    def speed_bounds(self, us: Array, first: Array) -> Array:
        """Return the highest u̇ to plan with at every u, shape (m,): wanted, or slowing down."""
        wanted = self.wanted(us, first)
        if self.slowing is None:
            return wanted
        slower = (1.0 + SLOWING_SLACK_SHARE) * self.slowing.speeds(us)
        return np.minimum(self.fastest(first), np.maximum(wanted, slower))
