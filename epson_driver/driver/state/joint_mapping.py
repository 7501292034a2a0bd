# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conversion between the controller's joint convention and ROS: coupling, signs, offsets.

FANUC and ABB define the third joint relative to the second one. Therefore, as in ROS-Industrial,
`j23_factor` times joint 2 is first added to joint 3 (FANUC's J23_factor; -1 for ABB). Each joint
in ROS is then `sign` times the controller's value, plus `offset`. The conversion to the controller
is the exact inverse. Velocities are converted without the offset.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from epson_driver.inputs import choice, list_of, number
from epson_driver.motion import Array

SIGNS = list_of(choice(1, -1))
OFFSETS = list_of(number(-1000.0, 1000.0))  # valid range of the parameter joint_offsets, rad or m


@dataclass(frozen=True, eq=False)
class JointMapping:
    """The mapping of n joints. `signs`: 1 or -1, shape (n,). `offsets`: shape (n,), rad or m.

    All methods convert arrays of shape (n,) or (points, n), in rad (m) or rad/s (m/s).
    """

    signs: Array
    offsets: Array
    j23_factor: int = 0

    @cached_property
    def identity(self) -> bool:
        return not self.j23_factor and bool(np.all(self.signs == 1.0) and not self.offsets.any())

    def positions_to_ros(self, values: Array) -> Array:
        return values if self.identity else self.velocities_to_ros(values) + self.offsets

    def velocities_to_ros(self, values: Array) -> Array:
        return values if self.identity else self.signs * self._coupled(values, self.j23_factor)

    def positions_to_controller(self, values: Array) -> Array:
        return values if self.identity else self.velocities_to_controller(values - self.offsets)

    def velocities_to_controller(self, values: Array) -> Array:
        return values if self.identity else self._coupled(self.signs * values, -self.j23_factor)

    def _coupled(self, values: Array, factor: int) -> Array:
        if not factor:
            return values
        coupled = values.copy()
        coupled[..., 2] += factor * values[..., 1]
        return coupled


def joint_mapping(
    joints: int, signs: Sequence[int], offsets: Sequence[float], j23_factor: int
) -> JointMapping:
    """Return the mapping for the parameters. A single sign or offset applies to all joints."""
    for name, values in (('joint_signs', signs), ('joint_offsets', offsets)):
        if len(values) not in (1, joints):
            raise ValueError(
                f'parameter {name} = {list(values)}: needs one number, or {joints}: one per joint'
            )
    SIGNS.checked(list(signs), 'parameter joint_signs')
    OFFSETS.checked(list(offsets), 'parameter joint_offsets')
    if j23_factor and joints < 3:
        raise ValueError(f'parameter j23_factor = {j23_factor}: must be 0 for {joints} joints')
    return JointMapping(
        np.ones(joints) * np.array(signs, dtype=float),
        np.zeros(joints) + np.array(offsets, dtype=float),
        j23_factor,
    )


def unmapped(joints: int) -> JointMapping:
    return JointMapping(np.ones(joints), np.zeros(joints))
