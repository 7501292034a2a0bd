# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The second line of defence: what is given out is held against what was given out before.

It trusts no planner and no judge. From two outputs and the time between them follows what the
motion between them must at least have asked of the joints:

- a jerk of J changes the acceleration by no more than J dt;
- the velocity by the mean of both accelerations times dt, give or take J dt²/4;
- the position as a linear acceleration would, give or take J dt³/8.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from epson_driver.motion.limits import Array, JointLimits

ROUNDING = 1e-6
"""Share of a limit that is taken for rounding."""

POSITION_ROUNDING = 5e-9
"""The same for positions, rad."""


class Motion(NamedTuple):
    """Where the joints are to be now: shapes (n,), in rad, rad/s, rad/s²."""

    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, slots=True)
class Violation:
    """A limit that an output does not keep."""

    joint: str
    quantity: str
    value: float
    limit: float
    unit: str

    def __str__(self) -> str:
        """Return it as a part of a sentence."""
        return (
            f'{self.joint}: {self.quantity} {self.value:.6g} {self.unit} is beyond the limit '
            f'{self.limit:.6g} {self.unit}'
        )


class OutputGuard:
    """Holds each output against the limits and the output before it."""

    def __init__(self, motion: Motion) -> None:
        self.last = motion

    def violation(self, motion: Motion, dt: float, limits: JointLimits) -> Violation | None:
        """Return the first limit that the next output, `dt` ≥ 0 s after the last, does not keep.

        None: it keeps all, and is the last output from now on.
        """
        q, v, a = motion
        q0, v0, a0 = self.last
        jerk = limits.jerk * dt
        # a and v may have crept to just beyond where they must be, each by rounding
        slips = (
            np.abs(q - q0 - dt * (v0 + dt * (2.0 * a0 + a) / 6.0)),
            np.abs(v - v0 - dt * (a0 + a) / 2.0),
        )
        v_slack, a_slack = ROUNDING * limits.velocity, ROUNDING * limits.acceleration
        checks = (
            ('position', q, limits.position_max + POSITION_ROUNDING, ''),
            ('position', -q, -limits.position_min + POSITION_ROUNDING, ''),
            ('velocity', np.abs(v), limits.velocity + v_slack, '/s'),
            ('acceleration', np.abs(a), limits.acceleration + a_slack, '/s²'),
            ('change of acceleration', np.abs(a - a0), jerk + a_slack, '/s²'),
            (
                'change of velocity beside the acceleration',
                slips[1],
                jerk * dt / 4.0 + v_slack + a_slack * dt,
                '/s',
            ),
            (
                'change of position beside the velocity',
                slips[0],
                jerk * dt**2 / 8.0 + POSITION_ROUNDING + (v_slack + a_slack * dt) * dt,
                '',
            ),
        )
        for quantity, values, bounds, per in checks:
            kept = values <= bounds
            if not kept.all():  # NaN too
                joint = int(np.argmin(kept))
                sign = -1.0 if values is checks[1][1] else 1.0
                return Violation(
                    limits.names[joint],
                    quantity,
                    sign * float(values[joint]),
                    sign * float(bounds[joint]),
                    limits.units[joint] + per,
                )
        self.last = motion
        return None
