# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Inverse kinematics of a SCARA: two links that turn in a plane, a vertical joint, a turning one.

Only the simulated controller uses it, for programs in SPEL+ that name places in space.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.kinematics import Branches, Kinematics
from epson_driver.robots.model import RobotModel
from epson_driver.robots.opw import KinematicsError

SCARA = 'SCARA'

PLACE_TOLERANCE = 1e-9
"""How far Tool 0 may be from the axis of joint 4, m, and an axis from upright (1 - cosine)."""

POSE_TOLERANCE = 1e-6
"""How far a solution may be from the pose, m and rad: a pose that is tilted has none."""


def kinematics_of(model: RobotModel) -> Kinematics:
    """Return the kinematics of a model, which of a SCARA have an inverse too."""
    return ScaraKinematics(model) if model.kind == SCARA else Kinematics(model)


class ScaraKinematics(Kinematics):
    """Forward and inverse kinematics of a SCARA. Raises KinematicsError, as `inverse` does."""

    @cached_property
    def _solver(self) -> Branches:
        return _Solver(self.model, self.forward)


class _Solver:
    def __init__(self, model: RobotModel, forward: Callable[[Array], Array]) -> None:
        chain = model.chain
        if model.kind != SCARA or np.any(np.abs(chain.axes[:, 2]) < 1.0 - PLACE_TOLERANCE):
            raise KinematicsError(f'{model.name}: it is no SCARA with upright axes')
        if np.any(np.abs(model.tool0.xyz[:2]) > PLACE_TOLERANCE):
            raise KinematicsError(f'{model.name}: Tool 0 is not on the axis of joint 4')
        self._forward = forward
        self._signs = np.sign(chain.axes[:, 2])
        self._shoulder = chain.origins[0][:2]
        inner, outer = chain.origins[1][:2], (chain.origins[2] + chain.origins[3])[:2]
        self._lengths = float(np.linalg.norm(inner)), float(np.linalg.norm(outer))
        self._angles = _direction(inner), _direction(outer)
        zero = forward(np.zeros(4))
        self._height, self._turn = float(zero[2, 3]), _yaw(zero)

    def branches(self, pose: Array, _near: Array) -> list[Array]:
        """Return the solutions with the elbow to either side, regardless of the joint limits."""
        way = pose[:2, 3] - self._shoulder
        inner, outer = self._lengths
        cosine = (float(way @ way) - inner**2 - outer**2) / (2.0 * inner * outer)
        if abs(cosine) > 1.0 + PLACE_TOLERANCE:
            return []
        bend = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        found = (self._joints(pose, way, elbow) for elbow in (bend, -bend))
        return [
            joints
            for joints in found
            if np.max(np.abs(self._forward(joints) - pose)) < POSE_TOLERANCE
        ]

    def _joints(self, pose: Array, way: Array, elbow: float) -> Array:
        """Return the joints where the outer link turns by `elbow`, rad, from the inner one."""
        inner, outer = self._lengths
        reached = np.arctan2(outer * np.sin(elbow), inner + outer * np.cos(elbow))
        first = _direction(way) - reached - self._angles[0]
        second = elbow + self._angles[0] - self._angles[1]
        last = _yaw(pose) - self._turn - first - second
        turns = np.array([first, second, pose[2, 3] - self._height, last])
        return np.asarray(turns * self._signs)


def _direction(vector: Array) -> float:
    return float(np.arctan2(vector[1], vector[0]))


def _yaw(pose: Array) -> float:
    return float(np.arctan2(pose[1, 0], pose[0, 0]))
