# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joints along a line or an arc of the tool, past singularities as AvoidSingularity is at first.

The N series keeps to the way, and turns its joints as far as that takes (SING_VSD, p158). Other
six-axis arms pass a singularity of the wrist or the hand by another way (SING_THRU, p158): the
manual does not say by which. Here the tool's place stays on its line, and its orientation leaves
it, while joint 5, or the wrist's distance from joint 1's axis, goes straight through 0.
"""

import math
from collections.abc import Iterator

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.kinematics import Kinematics
from epson_driver.tool_motion.pose_path import PosePath

STEP_M = 0.02
STEP_RAD = 0.1
"""How densely a line is looked at, at first; between, a spline is near it by some micrometres."""

MIN_LOOKS, MAX_LOOKS = 10, 500
FINER = 4
"""Where a joint jumps from one look to the next, all are so much denser."""

MAX_JOINT_STEP = 0.3
"""A joint that changes by more from one look to the next, rad or m, jumps."""

NEAR_WRIST_RAD = math.radians(10.0)
"""Joint 5 this near to 0 is near a singularity: SingularityAngle until it is set (p158)."""

NEAR_HAND_M = 0.03
"""The wrist this near to joint 1's axis: SingularityDist until it is set (p158)."""

MOST_TURN_RAD = 2.0 * NEAR_WRIST_RAD
"""The tool is turned by no more beside its way."""

ON_LINE_M, TRIES = 1e-9, 10
JOINT_5 = 4


def joints_along(kinematics: Kinematics, path: PosePath, start: Array, through: bool) -> Array:
    """Return joints at even shares of a way, from those that are at its begin: shape (k, n).

    through: whether a singularity is passed by another way. Raises ValueError that says why
    there are none, and KinematicsError.
    """
    longest = max(path.length / STEP_M, path.angle / STEP_RAD)
    looks = min(max(math.ceil(longest), MIN_LOOKS), MAX_LOOKS)
    while True:
        try:
            return _Looks(kinematics, path, start, looks).joints(through)
        except _JumpError:
            if looks == MAX_LOOKS:
                raise
            looks = min(looks * FINER, MAX_LOOKS)


class _JumpError(ValueError):
    pass


class _Looks:
    def __init__(self, kinematics: Kinematics, path: PosePath, start: Array, looks: int) -> None:
        self._kinematics = kinematics
        self._poses = [path.pose(share) for share in np.linspace(0.0, 1.0, looks + 1).tolist()]
        self._rows = [start]
        self._behind = 0  # so far singularities are passed

    def joints(self, through: bool) -> Array:
        while (place := len(self._rows)) < len(self._poses):
            near = self._rows[-1]
            found = self._kinematics.inverse(self._poses[place], near)
            at = f'at {place / (len(self._poses) - 1) * 100.0:.0f} % of the way'
            if not len(found):
                raise ValueError(f'it is out of reach {at}')
            if np.max(np.abs(found[0] - near)) <= MAX_JOINT_STEP:
                self._rows.append(found[0])
            elif not (through and self._passed()):
                raise _JumpError(f'a joint would have to jump {at}')
        return np.array(self._rows)

    def _passed(self) -> bool:
        """Return whether the arm can go through the last singularity, and make it do so."""
        begin = len(self._rows) - 1
        while begin > self._behind and not self._near(self._rows[begin]):
            begin -= 1
        if not self._near(self._rows[begin]):
            return False
        while begin > self._behind and self._near(self._rows[begin]):
            begin -= 1
        entry = self._rows[begin]
        side = self._sides(entry)
        for end in range(begin + 2, len(self._poses)):
            found = self._kinematics.inverse(self._poses[end], entry)
            if not len(found):
                return False
            near = self._near(found[0]) and end < len(self._poses) - 1
            beyond = np.any(self._sides(found[0]) * side <= 0.0)
            if near or not beyond or np.max(np.abs(found[0] - entry)) > np.pi / 2.0:
                continue
            rows = [entry, *self._between(begin, end, entry, found[0])]
            fits = len(rows) > end - begin
            fits = fits and np.max(np.abs(np.diff(rows, axis=0))) <= MAX_JOINT_STEP
            if fits:
                self._rows[begin:], self._behind = rows, end
            return bool(fits)
        return False

    def _sides(self, joints: Array) -> Array:
        hand, _, wrist = self._kinematics.sides(joints)
        return np.array([hand, wrist])

    def _near(self, joints: Array) -> bool:
        return bool(np.any(np.abs(self._sides(joints)) < (NEAR_HAND_M, NEAR_WRIST_RAD)))

    def _between(self, begin: int, end: int, entry: Array, leave: Array) -> Iterator[Array]:
        """Yield joints with the tool's place on its line, nearly evenly between two."""
        limits = self._kinematics.model.limits
        for index in range(begin + 1, end):
            joints = entry + (leave - entry) * (index - begin) / (end - begin)
            for _ in range(TRIES):
                tool = self._kinematics.forward(joints)
                off = self._poses[index][:3, 3] - tool[:3, 3]
                if np.max(np.abs(off)) < ON_LINE_M:
                    break
                slope = self._kinematics.jacobian(joints)[:3]
                joints += np.linalg.lstsq(slope, off, rcond=None)[0]
            outside = np.any((joints < limits.position_min) | (joints > limits.position_max))
            turned = np.trace(self._poses[index][:3, :3].T @ tool[:3, :3])
            twisted = (turned - 1.0) / 2.0 < math.cos(MOST_TURN_RAD)
            if outside or twisted or np.max(np.abs(off)) >= ON_LINE_M:
                return
            yield joints
        yield leave
