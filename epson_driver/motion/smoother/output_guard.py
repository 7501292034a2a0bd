# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Check of each output of the smoother against the limits and the previous output.

The check is independent of the planner and its verification. If the jerk between two outputs is at
most J, and dt is the time between them, then

- the acceleration changes by x J dt, with |x| ≤ 1,
- the velocity changes as with a linear acceleration, ± (1 - x²) J dt²/4,
- the position changes as with a linear acceleration, ± (1 - x²) (1 + |x|/3) J dt³/8.

These bounds follow from the largest deviation of the acceleration from the straight line between
its end values: it first rises with J and then falls with J.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from epson_driver.motion.limits import Array, JointLimits

LIMIT_TOLERANCE_SHARE = 1e-6
"""Tolerance for rounding at a velocity or acceleration limit, relative to it."""

POSITION_TOLERANCE = 5e-9
"""Tolerance for rounding at a position limit, rad."""


class Motion(NamedTuple):
    """Commanded state of the joints, shapes (n,), in rad, rad/s, rad/s²."""

    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, slots=True)
class Violation:
    joint: str
    quantity: str
    value: float
    limit: float
    unit: str

    def __str__(self) -> str:
        return (
            f'{self.joint}: {self.quantity} {self.value:.6g} {self.unit} is beyond the limit '
            f'{self.limit:.6g} {self.unit}'
        )


_QUANTITIES = (
    ('position', ''),
    ('position', ''),
    ('velocity', '/s'),
    ('acceleration', '/s²'),
    ('change of acceleration', '/s²'),
    ('change of velocity minus the mean acceleration', '/s'),
    ('change of position minus the mean velocity', ''),
)
"""Name of the quantity in each row of `values` and `bounds`, and suffix to the joint's unit."""

_ABOVE, _BELOW, _CHANGE, _SLIP_OF_VELOCITY, _SLIP_OF_POSITION = 0, 1, 4, 5, 6


class OutputGuard:
    """Checks each output against the limits and the previous output. `motion`: initial state."""

    def __init__(self, motion: Motion) -> None:
        self.last = motion
        self._bounds_of: tuple[JointLimits, float] | None = None
        self._bounds = self._rounding = np.empty(0)

    def violation(self, motion: Motion, dt: float, limits: JointLimits) -> Violation | None:
        """Return the first exceeded limit. If there is none, store `motion`, and return None."""
        values, bounds = self._values(Motion(*(part[None] for part in motion)), dt, limits)
        if not (values <= bounds).all():  # NaN too
            return _violation(values[:, 0], bounds[:, 0], limits)
        self.last = motion
        return None

    def allows(self, motions: Motion, dt: float, limits: JointLimits) -> bool:
        """Return whether outputs, shapes (m, n), exceed no limit, and store the last of them."""
        values, bounds = self._values(motions, dt, limits)
        allowed = bool((values <= bounds).all())
        if allowed:
            self.last = Motion(*(part[-1] for part in motions))
        return allowed

    def _values(self, motions: Motion, dt: float, limits: JointLimits) -> tuple[Array, Array]:
        """Return the values of all _QUANTITIES, and their bounds, shapes (7, m, n)."""
        if self._bounds_of is None or self._bounds_of[0] is not limits or self._bounds_of[1] != dt:
            self._bounds, self._rounding = _bounds(limits, dt), _rounding(limits, dt)
            self._bounds_of = limits, dt
        q, v, a = motions
        q0, v0, a0 = (
            np.concatenate((old[None], new[:-1]))
            for old, new in zip(self.last, motions, strict=True)
        )
        values = np.empty((len(_QUANTITIES), *q.shape))
        np.subtract(q, limits.position_max, out=values[_ABOVE])
        np.subtract(limits.position_min, q, out=values[_BELOW])
        values[2], values[3] = v, a
        change = values[_CHANGE] = a - a0
        values[_SLIP_OF_VELOCITY] = v - v0 - (dt / 2.0) * (a0 + a)
        values[_SLIP_OF_POSITION] = q - q0 - dt * (v0 + (dt / 6.0) * (a0 + a0 + a))
        np.abs(values[2:], out=values[2:])
        bounds = self._bounds[:, None].repeat(len(q), axis=1)
        if dt > 0.0:
            x = np.minimum(np.abs(change) / bounds[_CHANGE], 1.0)
            bounds[_SLIP_OF_VELOCITY] *= 1.0 - x * x
            bounds[_SLIP_OF_POSITION] *= (1.0 - x * x) * (1.0 + x / 3.0)
        bounds += self._rounding[:, None]
        return values, bounds


def _bounds(limits: JointLimits, dt: float) -> Array:
    """Return the bounds of all _QUANTITIES for x = 0 (see above), without tolerances, (7, n)."""
    zeros, change = np.zeros_like(limits.jerk), limits.jerk * dt
    rows = [zeros, zeros, limits.velocity, limits.acceleration, change]
    return np.array([*rows, change * dt / 4.0, change * dt**2 / 8.0])


def _rounding(limits: JointLimits, dt: float) -> Array:
    position = np.full_like(limits.jerk, POSITION_TOLERANCE)
    v, a = LIMIT_TOLERANCE_SHARE * limits.velocity, LIMIT_TOLERANCE_SHARE * limits.acceleration
    return np.array([position, position, v, a, a, v + a * dt, position + (v + a * dt) * dt])


def _violation(values: Array, bounds: Array, limits: JointLimits) -> Violation:
    row, joint = (int(index) for index in np.argwhere(~(values <= bounds))[0])
    value, bound = float(values[row, joint]), float(bounds[row, joint])
    if row == _ABOVE:
        bound = float(limits.position_max[joint])
        value += bound
    elif row == _BELOW:
        bound = float(limits.position_min[joint])
        value = bound - value
    quantity, per = _QUANTITIES[row]
    return Violation(limits.names[joint], quantity, value, bound, limits.units[joint] + per)
