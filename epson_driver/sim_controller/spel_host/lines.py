# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint angles along a line or an arc of the tool, which the arm follows exactly.

The N series turns its joints as far as necessary (SING_VSD, SPEL+ manual p158). Other six-axis
arms leave the path near a singularity of the wrist or the hand (SING_THRU, p157), in a way that
the manual does not specify. Here such a path is refused.
"""

import math

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.pose_path import PosePath

STEP_M = 0.02
STEP_RAD = 0.1
"""Initial sample spacing along a path, m and rad. The spline between the samples then deviates
from the path by some micrometres."""

MIN_SAMPLES, MAX_SAMPLES = 10, 500
FINER = 4
"""Factor by which the number of samples increases if a joint jumps between two samples."""

MAX_JOINT_STEP = 0.3
"""Maximum change of a joint between two samples, rad or m. A larger change is a jump."""

NEAR_WRIST_RAD, NEAR_HAND_M = math.radians(10.0), 0.03
"""Initial SingularityAngle of joint 5, and SingularityDist of the wrist from joint 1's axis."""


def joints_along(kinematics: Kinematics, path: PosePath, start: Array, avoids: bool) -> Array:
    """Return joint angles, shape (k, n), rad, at evenly spaced fractions of a path of the tool.

    `start`: joint angles at its start, shape (n,), rad. `avoids`: whether a real arm leaves the
    path near a singularity. Raises ValueError if no solution exists, KinematicsError if the robot
    has no inverse kinematics.
    """
    longest = max(path.length / STEP_M, path.angle / STEP_RAD)
    samples = min(max(math.ceil(longest), MIN_SAMPLES), MAX_SAMPLES)
    while True:
        try:
            return _joints(kinematics, path, start, samples, avoids)
        except _JumpError:
            if samples == MAX_SAMPLES:
                raise
            samples = min(samples * FINER, MAX_SAMPLES)


class _JumpError(ValueError):
    pass


def _joints(
    kinematics: Kinematics, path: PosePath, start: Array, samples: int, avoids: bool
) -> Array:
    rows = [start]
    for number in range(1, samples + 1):
        result = kinematics.inverse(path.pose(number / samples), rows[-1])
        where = f'at {number / samples * 100.0:.0f} % of the path'
        if not len(result):
            raise ValueError(f'out of reach {where}')
        if np.max(np.abs(result[0] - rows[-1])) > MAX_JOINT_STEP:
            if avoids and any(_is_near(kinematics, joints) for joints in (rows[-1], result[0])):
                raise ValueError(f'a singularity {where}: AvoidSingularity is not simulated')
            raise _JumpError(f'a joint would have to jump {where}')
        rows.append(result[0])
    return np.array(rows)


def _is_near(kinematics: Kinematics, joints: Array) -> bool:
    """Return whether a six-axis arm is near a singularity of its wrist or hand."""
    hand, _, wrist = kinematics.sides(joints)
    return abs(hand) < NEAR_HAND_M or abs(wrist) < NEAR_WRIST_RAD
