# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The lengths that determine the shape of a six-axis arm, from the chain of its model."""

from dataclasses import dataclass

import numpy as np

from epson_driver.robots import RobotModel

MM = 1000.0
THICKEST = 1.25


@dataclass(frozen=True)
class Dimensions:
    """Lengths in mm at the zero pose: upper arm upright, forearm to the front.

    base: height of the first joint's frame. shoulder_x, shoulder_z: joint 2 in link 1. upper: from
    joint 2 to joint 3. elbow_x, elbow_z: joint 4's frame in link 3. forearm: joint 5 in link 4.
    wrist: joint 6's frame in link 5. flange: the flange's face in link 6. thickness: 1 for the C3,
    the measure of all that the chain does not tell.
    """

    base: float
    shoulder_x: float
    shoulder_z: float
    upper: float
    elbow_x: float
    elbow_z: float
    forearm: float
    wrist: float
    flange: float
    thickness: float


def dimensions(model: RobotModel) -> Dimensions:
    """Return the lengths of a six-axis model. Raises ValueError if it is built otherwise."""
    origins = model.chain.origins * MM
    expected = np.zeros((6, 3), dtype=bool)
    for joint, axis in ((0, 2), (1, 0), (1, 2), (2, 2), (3, 0), (3, 2), (4, 0), (5, 0)):
        expected[joint, axis] = True
    beside = origins.shape != (6, 3) or np.any(np.abs(origins[~expected]) > 1e-6)
    if beside or np.any(origins[[0, 1, 2, 4], [2, 2, 2, 0]] <= 0.0):
        raise ValueError(f'{model.name}: no mesh can be made for this chain')
    base, shoulder_x, shoulder_z = origins[0, 2], origins[1, 0], origins[1, 2]
    # stretched forward and down, the upper arm just passes the base and the turret
    down = np.tan(np.pi + model.limits.position_min[1])
    room = np.inf if down < 0.0 else (shoulder_x + shoulder_z * down) / 145.0
    thickness = min((base + shoulder_z) / 320.0, room, THICKEST)
    return Dimensions(
        base=base,
        shoulder_x=shoulder_x,
        shoulder_z=shoulder_z,
        upper=origins[2, 2],
        elbow_x=origins[3, 0],
        elbow_z=origins[3, 2],
        forearm=origins[4, 0],
        wrist=origins[5, 0],
        flange=model.tool0.xyz[0] * MM,
        thickness=round(float(thickness), 2),
    )
