# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The joint limits that every commanded motion respects (docs/invariants.md, 2)."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

ROUNDING = {'rad': 5e-5, 'm': 5e-6}
"""Maximum excess of the reported position of a joint at its position limit, by unit: the
controller counts encoder pulses and sends float32. The limits in the URDF are wider by this."""


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of n joints: arrays of shape (n,), in rad, rad/s, rad/s², rad/s³ (or m …).

    units: 'rad' or 'm' for each joint, by default 'rad'. Raises ValueError if the lengths
    differ, a number is not finite, a range is empty, or a limit is not positive.
    """

    names: tuple[str, ...]
    position_min: Array
    position_max: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.names or len(set(self.names)) != len(self.names):
            raise ValueError(
                f'at least one joint name is needed, and all must differ: {self.names}'
            )
        units = self.units or ('rad',) * len(self.names)
        if len(units) != len(self.names) or not set(units) <= {'rad', 'm'}:
            raise ValueError(f'units must be rad or m, one per joint: {units}')
        object.__setattr__(self, 'units', units)
        for quantity in ('position_min', 'position_max', 'velocity', 'acceleration', 'jerk'):
            values = np.array(getattr(self, quantity), dtype=float)
            if values.shape != (len(self.names),):
                raise ValueError(f'{quantity}: {values.size} values for {len(self.names)} joints')
            for name, value in zip(self.names, values, strict=True):
                if not np.isfinite(value):
                    raise ValueError(f'{name}: {quantity} = {value} is not finite')
                if not quantity.startswith('position') and value <= 0.0:
                    raise ValueError(f'{name}: {quantity} = {value} must be positive')
            values.flags.writeable = False
            object.__setattr__(self, quantity, values)
        for name, low, high in zip(self.names, self.position_min, self.position_max, strict=True):
            if low >= high:
                raise ValueError(f'{name}: position range {low} … {high} is empty')

    @cached_property
    def rounding(self) -> Array:
        return np.array([ROUNDING[unit] for unit in self.units])

    def settled(self, positions: Array) -> Array:
        """Return positions, shape (…, n), clipped where they exceed a limit by rounding only."""
        low, high = self.position_min, self.position_max
        rows = positions.reshape(-1, positions.shape[-1])
        if not rows.size or (np.all(rows.min(axis=0) >= low) and np.all(rows.max(axis=0) <= high)):
            return positions  # a long goal is not copied
        near = (positions >= low - self.rounding) & (positions <= high + self.rounding)
        return np.where(near, np.clip(positions, low, high), positions)

    def scaled(self, speed: float, acceleration: float) -> 'JointLimits':
        """Return the limits multiplied by fractions, (0, 1].

        `speed` applies to the velocity, `acceleration` to the acceleration and the jerk.
        """
        return replace(
            self,
            velocity=self.velocity * speed,
            acceleration=self.acceleration * acceleration,
            jerk=self.jerk * acceleration,
        )

    @property
    def rad_per_unit(self) -> Array:
        """Factor from each joint's unit to rad, for comparing joints, shape (n,).

        For a prismatic joint, the factor is the velocity limit of the first revolute joint divided
        by the prismatic joint's, so that moves of equal duration have equal lengths.
        """
        revolute = [unit == 'rad' for unit in self.units]
        fastest = self.velocity[revolute.index(True)] if any(revolute) else 1.0
        return np.where(revolute, 1.0, fastest / self.velocity)
