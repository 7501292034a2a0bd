# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A smoother's motion, and ramps of the rate at which the arm moves along it.

If the time u of the smoother passes at a rate r, the arm has r times the velocity, and
r² times the acceleration plus r' times the velocity. A constant rate up to 1 is therefore within
the limits. A ramp is used only if all of its targets were checked.
"""

import numpy as np
from ruckig import ControlInterface, InputParameter

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.joint_motion import JointMotion
from epson_driver.motion.point_to_point import solve
from epson_driver.motion.smoother import Motion, Smoother
from epson_driver.motion.smoother.request import ActivePlan
from epson_driver.motion.time_parametrisation import (
    State,
    TimeParametrisation,
    from_pieces,
    from_ruckig,
)

MAX_RAMP_PER_S, MAX_RAMP_CHANGE = 8.0, 400.0
"""Maximum rate of change of the rate, 1/s, and of the rate of change itself, 1/s²."""

FOREVER_S = 1e9
KEPT_S = 2.0  # minimum time for which the motion is kept, s: longer than that of the targets ahead


def ramp(state: State, rate: float, share: float = 1.0) -> TimeParametrisation:
    """Return the times u of a smoother from a state to a constant rate, as the last piece.

    share: share of the maximum change per time, and its square of the maximum second change.
    """
    inp = InputParameter(1)
    inp.control_interface = ControlInterface.Velocity
    inp.current_velocity, inp.current_acceleration = [state[1]], [state[2]]
    inp.target_velocity = [rate]
    inp.max_acceleration, inp.max_jerk = [share * MAX_RAMP_PER_S], [share**2 * MAX_RAMP_CHANGE]
    pieces = from_ruckig(solve(inp))
    durations = np.append(np.diff(pieces.times), FOREVER_S)
    timing = from_pieces(state, durations, np.append(pieces.jerks, 0.0))
    timing.velocities[-2], timing.accelerations[-2] = rate, 0.0  # without rounding
    return timing


class KnownMotion(Smoother):
    """A smoother that starts at rest at `position`, and keeps the motion before its time."""

    def __init__(self, limits: JointLimits, position: Array) -> None:
        self._parts: list[tuple[float, ActivePlan | Array]] = [(0.0, position)]
        super().__init__(limits, position, observer=self._keep)

    def _keep(self, start: float, motion: ActivePlan | JointMotion | None) -> None:
        # an arm that leaves its plan brakes because of a failure, after which nothing is sampled
        part = motion if isinstance(motion, ActivePlan) else self.motion.position
        self._parts.append((start, part))
        while self._parts[1][0] < start - KEPT_S:
            del self._parts[0]

    def sample(self, timing: TimeParametrisation, times: Array) -> tuple[Array, Motion]:
        """Return the times u of `timing`, no later than now, and the motion there.

        The shapes are (m,) and (m, n).
        """
        u, rate, change, _ = (part[:, None] for part in timing.sample(times))
        u = np.minimum(u[:, 0], self.now)
        parts = np.searchsorted([start for start, _ in self._parts], u, side='right') - 1
        q = np.empty((len(u), len(self.limits.names)))
        v, a = np.zeros_like(q), np.zeros_like(q)
        for index in np.unique(parts).tolist():
            rows, part = parts == index, self._parts[index][1]
            if isinstance(part, ActivePlan):
                q[rows], v[rows], a[rows] = part.along(u[rows])
            else:
                q[rows] = part
        return u, Motion(q, v * rate, a * rate**2 + v * change)
