# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint angles along a line or an arc of the tool, with AvoidSingularity in its initial mode.

The N series stays on the path and turns its joints as far as necessary (SING_VSD, p158). Other
six-axis arms pass a singularity of the wrist or the hand on a different path (SING_THRU, p158),
which the manual does not specify. Here the tool position stays on its line, and the orientation
deviates while joint 5, or the distance of the wrist from joint 1's axis, changes linearly through
0.
"""

import math
from collections.abc import Iterator

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.pose_path import PosePath

STEP_M = 0.02
STEP_RAD = 0.1
"""Initial sample spacing along a path, m and rad. The spline between the samples then deviates
from the path by some micrometres."""

MIN_STEPS, MAX_STEPS = 10, 500
FINER = 4
"""Factor by which the number of samples increases if a joint jumps between two samples."""

MAX_JOINT_STEP = 0.3
"""Maximum change of a joint between two samples, rad or m. A larger change is a jump."""

NEAR_WRIST_RAD = math.radians(10.0)
"""Angle of joint 5 below which the arm is near a wrist singularity: SingularityAngle (p158)."""

NEAR_HAND_M = 0.03
"""Distance of the wrist from joint 1's axis below which the arm is near a hand singularity, m.

It is the initial value of SingularityDist (p158).
"""

MAX_TURN_RAD = 2.0 * NEAR_WRIST_RAD
"""Maximum deviation of the tool's orientation from its path, rad."""

ON_LINE_M, MAX_ITERATIONS = 1e-9, 10


def joints_along(kinematics: Kinematics, path: PosePath, start: Array, through: bool) -> Array:
    """Return joint angles, shape (k, n), at even fractions of a path. The first row is `start`.

    through: whether a singularity may be passed on a different path. Raises ValueError if no
    solution exists, KinematicsError if the robot has no inverse kinematics.
    """
    longest = max(path.length / STEP_M, path.angle / STEP_RAD)
    steps = min(max(math.ceil(longest), MIN_STEPS), MAX_STEPS)
    while True:
        try:
            return _SampledPath(kinematics, path, start, steps).joints(through)
        except _JumpError:
            if steps == MAX_STEPS:
                raise
            steps = min(steps * FINER, MAX_STEPS)


class _JumpError(ValueError):
    pass


class _SampledPath:
    def __init__(self, kinematics: Kinematics, path: PosePath, start: Array, steps: int) -> None:
        self._kinematics = kinematics
        self._poses = [
            path.pose(fraction) for fraction in np.linspace(0.0, 1.0, steps + 1).tolist()
        ]
        self._rows = [start]
        self._behind = 0  # index of the sample after the last singularity that was passed

    def joints(self, through: bool) -> Array:
        while (index := len(self._rows)) < len(self._poses):
            near = self._rows[-1]
            result = self._kinematics.inverse(self._poses[index], near)
            at = f'at {index / (len(self._poses) - 1) * 100.0:.0f} % of the path'
            if not len(result):
                raise ValueError(f'out of reach {at}')
            if np.max(np.abs(result[0] - near)) <= MAX_JOINT_STEP:
                self._rows.append(result[0])
            elif not (through and self._pass_singularity()):
                raise _JumpError(f'a joint would have to jump {at}')
        return np.array(self._rows)

    def _pass_singularity(self) -> bool:
        """Replace the last samples with a path through the singularity near them, if possible.

        Return whether this succeeded.
        """
        start = len(self._rows) - 1
        while start > self._behind and not self._near(self._rows[start]):
            start -= 1
        if not self._near(self._rows[start]):
            return False
        while start > self._behind and self._near(self._rows[start]):
            start -= 1
        entry = self._rows[start]
        side = self._sides(entry)
        for end in range(start + 2, len(self._poses)):
            result = self._kinematics.inverse(self._poses[end], entry)
            if not len(result):
                return False
            near = self._near(result[0]) and end < len(self._poses) - 1
            beyond = np.any(self._sides(result[0]) * side <= 0.0)
            if near or not beyond or np.max(np.abs(result[0] - entry)) > np.pi / 2.0:
                continue
            rows = [entry, *self._between(start, end, entry, result[0])]
            fits = len(rows) > end - start
            fits = fits and np.max(np.abs(np.diff(rows, axis=0))) <= MAX_JOINT_STEP
            if fits:
                self._rows[start:], self._behind = rows, end
            return bool(fits)
        return False

    def _sides(self, joints: Array) -> Array:
        hand, _, wrist = self._kinematics.sides(joints)
        return np.array([hand, wrist])

    def _near(self, joints: Array) -> bool:
        return bool(np.any(np.abs(self._sides(joints)) < (NEAR_HAND_M, NEAR_WRIST_RAD)))

    def _between(self, first: int, end: int, entry: Array, leave: Array) -> Iterator[Array]:
        """Yield joint angles nearly evenly from `entry` to `leave`, with the tool on its line.

        Stop early if a joint leaves its range or the orientation deviates too far.
        """
        limits = self._kinematics.model.limits
        for index in range(first + 1, end):
            joints = entry + (leave - entry) * (index - first) / (end - first)
            for _ in range(MAX_ITERATIONS):
                tool = self._kinematics.forward(joints)
                off = self._poses[index][:3, 3] - tool[:3, 3]
                if np.max(np.abs(off)) < ON_LINE_M:
                    break
                slope = self._kinematics.jacobian(joints)[:3]
                joints += np.linalg.lstsq(slope, off, rcond=None)[0]
            outside = np.any((joints < limits.position_min) | (joints > limits.position_max))
            turned = np.trace(self._poses[index][:3, :3].T @ tool[:3, :3])
            twisted = (turned - 1.0) / 2.0 < math.cos(MAX_TURN_RAD)
            if outside or twisted or np.max(np.abs(off)) >= ON_LINE_M:
                return
            yield joints
        yield leave
