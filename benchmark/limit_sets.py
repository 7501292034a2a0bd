# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The joint limits under which every trajectory is run.

Velocities are from the arm's data sheet. Its accelerations are not published, so two sets
represent a lively and a calm arm. A/J, the time in which full acceleration builds up, is 0.1 and
0.2 s.
"""

from dataclasses import dataclass

import numpy as np

from epson_driver.motion import JointLimits
from epson_driver.robots import load_robot_model

MAX_VELOCITY_RAD_S = np.radians([450.0, 450.0, 514.0, 555.0, 555.0, 720.0])


@dataclass(frozen=True)
class Factors:
    """Acceleration as a multiple of the velocity, and jerk of the acceleration, both in 1/s."""

    acceleration: float
    jerk: float


FACTORS = {'full': Factors(10.0, 10.0), 'half': Factors(5.0, 5.0)}


def limit_set(name: str) -> JointLimits:
    """Return the `full` or `half` limit set, with the joint ranges of the EPSON C3."""
    model = load_robot_model('c3_a601s').limits
    factors = FACTORS[name]
    acceleration = factors.acceleration * MAX_VELOCITY_RAD_S
    return JointLimits(
        model.names,
        model.position_min,
        model.position_max,
        MAX_VELOCITY_RAD_S,
        acceleration,
        factors.jerk * acceleration,
    )


def ramp_time(limits: JointLimits) -> float:
    """Return the longest time in which a joint's acceleration builds up: A/J, s."""
    return float(np.max(limits.acceleration / limits.jerk))
