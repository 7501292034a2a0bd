# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Forward and inverse kinematics of Tool 0, or of a tool on it.

Poses are homogeneous matrices, shape (4, 4), m. Forward kinematics follow the chain and support
every model. Inverse kinematics are closed-form and support SCARAs and six-axis arms with a
spherical wrist.
"""

from functools import cached_property
from itertools import product
from math import ceil, floor
from typing import Protocol

import numpy as np

from epson_driver.motion import Array
from epson_driver.robots.chain import PRISMATIC, REVOLUTE, Frame, rotation_about
from epson_driver.robots.model import SCARA, RobotModel
from epson_driver.robots.opw import OpwSolver
from epson_driver.robots.scara import ScaraSolver

FULL_TURN = 2.0 * np.pi

LIMIT_TOLERANCE_RAD = 1e-9
"""Distance of a joint outside its range (rad, m) that counts as at the limit, due to rounding."""

SAME_SOLUTION_RAD = 1e-5
"""Solutions closer than this in all joints are merged. A stretched arm has such pairs."""

GIMBAL_LOCK_RAD = 1e-6
"""If EPSON's angle V is closer than this to ±π/2, it is treated as ±π/2."""


class Solver(Protocol):
    """A closed form for one kind of chain. Poses are poses of tool0 in base_link."""

    def branches(self, pose: Array, near: Array) -> list[Array]:
        """Return all solutions, also beyond the limits. In a singularity, `near` selects one."""

    def why_unreachable(self, pose: Array, /) -> str:
        """Return why the orientation of a pose is unreachable, or ''."""

    def sides(self, joints: Array, /) -> tuple[float, ...]:
        """Return a number for each choice of configuration. See `Kinematics.sides`."""


class Kinematics:
    """Forward and inverse kinematics of one model, from its data. Joints have shape (n,), rad, m.

    tool: the pose in tool0 of the frame that forward and inverse kinematics refer to, shape
    (4, 4), m. None: tool0 itself.

    >>> arm = Kinematics(load_robot_model('c3_a601s'))
    >>> pose = arm.forward(np.radians([0, 0, 0, 0, -90, 0]))
    >>> arm.inverse(pose)[0]
    """

    def __init__(self, model: RobotModel, tool: Array | None = None) -> None:
        self.model = model
        self._tool0 = model.tool0.matrix
        self._tool = np.eye(4) if tool is None else _checked_pose(tool)
        self._from_tool = np.linalg.inv(self._tool)
        self._world = model.base.matrix

    def link_frames(self, joints: Array) -> Array:
        """Return the frames of link_1 … link_n in base_link, shape (n, 4, 4)."""
        chain, types = self.model.chain, self.model.joint_types
        frames = np.empty((len(types), 4, 4))
        frame = np.eye(4)
        for index, value in enumerate(self._checked(joints)):
            step = np.eye(4)
            step[:3, 3] = chain.origins[index]
            if types[index] == PRISMATIC:
                step[:3, 3] += chain.axes[index] * value
            else:
                step[:3, :3] = rotation_about(chain.axes[index], value)
            frames[index] = frame = frame @ step
        return frames

    def forward(self, joints: Array) -> Array:
        """Return the pose of the tool in base_link, also for joints outside the limits."""
        return np.asarray(self.link_frames(joints)[-1] @ self._tool0 @ self._tool)

    def jacobian(self, joints: Array) -> Array:
        """Return the tool's velocity in base_link per joint velocity, shape (6, n).

        Rows: x, y, z, m/s, and the rotation about x, y, z, rad/s.
        """
        frames = self.link_frames(joints)
        tool = (frames[-1] @ self._tool0 @ self._tool)[:3, 3]
        columns = []
        rows = zip(frames, self.model.chain.axes, self.model.joint_types, strict=True)
        for frame, axis, kind in rows:
            turned = frame[:3, :3] @ axis
            if kind == PRISMATIC:
                columns.append(np.concatenate([turned, np.zeros(3)]))
            else:
                columns.append(np.concatenate([np.cross(turned, tool - frame[:3, 3]), turned]))
        return np.stack(columns, axis=1)

    def inverse(self, pose: Array, near: Array | None = None) -> Array:
        """Return all joint positions within the limits that bring the tool to a pose in base_link.

        The k results, shape (k, n), are sorted by the distance from `near` (default: all joints
        0). k is 0 if the pose is out of reach. A joint that can turn more than once is returned
        with every turn. In a wrist singularity (joint 5 of a six-axis arm is straight) joint 4 is
        as in `near`, one solution of infinitely many. If a six-axis arm's wrist, or a SCARA's
        folded arm, is on joint 1's axis, joint 1 is as in `near`.

        Raises KinematicsError for a chain without a closed form, and ValueError if the matrix is
        no pose.
        """
        pose = self._of_tool0(_checked_pose(pose))
        near = np.zeros(len(self.model.joint_names)) if near is None else self._checked(near)
        result: list[Array] = []
        for branch in self._solver.branches(pose, near):
            for joints in self._turns(branch):
                if not any(np.abs(joints - other).max() < SAME_SOLUTION_RAD for other in result):
                    result.append(joints)
        result.sort(key=lambda joints: float(np.linalg.norm(joints - near)))
        return np.array(result).reshape(-1, len(near))

    def why_unreachable(self, pose: Array) -> str:
        """Return why an orientation is unreachable, or ''. Raises the errors of `inverse`."""
        return self._solver.why_unreachable(self._of_tool0(_checked_pose(pose)))

    def sides(self, joints: Array) -> tuple[float, ...]:
        """Return a number for each choice of configuration, such as elbow up or down.

        The sign of a number is the choice. The number is 0 where both choices meet.

        SCARA: joint 2, rad. Six-axis arm: distance of the wrist in front of joint 1's axis, m, and
        bends of the elbow (upwards) and wrist, rad. Raises KinematicsError if the arm has no
        closed-form inverse kinematics.
        """
        return self._solver.sides(self._checked(joints))

    def in_base(self, pose: Array) -> Array:
        """Convert a pose from base_link to `base`, EPSON's world."""
        return np.asarray(np.linalg.inv(self._world) @ pose)

    def from_base(self, pose: Array) -> Array:
        """Convert a pose from `base`, EPSON's world, to base_link."""
        return np.asarray(self._world @ pose)

    def epson_point(self, joints: Array) -> tuple[Array, Array]:
        """Return the tool as the teach pendant shows it: X, Y, Z, m, and U, V, W, rad."""
        pose = self.in_base(self.forward(joints))
        return pose[:3, 3], uvw(pose[:3, :3])

    @cached_property
    def _solver(self) -> Solver:
        if self.model.kind == SCARA:
            return ScaraSolver(self.model)
        return OpwSolver(self.model)

    def _of_tool0(self, pose: Array) -> Array:
        """Convert a pose of the tool to a pose of tool0."""
        return np.asarray(pose @ self._from_tool)

    def _turns(self, branch: Array) -> list[Array]:
        """Return a solution's variants by full turns of its joints, as far as the ranges allow."""
        limits = self.model.limits
        choices = []
        kinds = self.model.joint_types
        lows, highs = limits.position_min.tolist(), limits.position_max.tolist()
        for value, low, high, kind in zip(branch.tolist(), lows, highs, kinds, strict=True):
            first = last = 0
            if kind == REVOLUTE:
                first = ceil((low - LIMIT_TOLERANCE_RAD - value) / FULL_TURN)
                last = floor((high + LIMIT_TOLERANCE_RAD - value) / FULL_TURN)
            elif not low - LIMIT_TOLERANCE_RAD <= value <= high + LIMIT_TOLERANCE_RAD:
                return []
            values = (value + FULL_TURN * turn for turn in range(first, last + 1))
            choices.append([min(max(item, low), high) for item in values])
        return [np.array(item) for item in product(*choices)]

    def _checked(self, joints: Array) -> Array:
        joints = np.asarray(joints, dtype=float)
        if joints.shape != (len(self.model.joint_names),) or not np.all(np.isfinite(joints)):
            count = len(self.model.joint_names)
            raise ValueError(f'joints = {joints.tolist()}: must be {count} finite numbers')
        return joints


def uvw(rotation: Array) -> Array:
    """Return EPSON's U, V, W, rad, of a rotation matrix: about Z, then the new Y, then the new X.

    U and W are in [-π, π], V in [-π/2, π/2]. If V is ±π/2, only the sum or the difference of U
    and W is defined, and U is 0.
    """
    r = np.asarray(rotation, dtype=float)
    across = float(np.hypot(r[0, 0], r[1, 0]))
    v = np.arctan2(-r[2, 0], across)
    if across > GIMBAL_LOCK_RAD:
        return np.array([np.arctan2(r[1, 0], r[0, 0]), v, np.arctan2(r[2, 1], r[2, 2])])
    return np.array([0.0, v, np.arctan2(-r[1, 2], r[1, 1])])


def rotation_of_uvw(angles: Array) -> Array:
    """Return the rotation matrix of EPSON's U, V, W, rad."""
    u, v, w = np.asarray(angles, dtype=float)
    return Frame(np.zeros(3), np.array([w, v, u])).matrix[:3, :3]


def _checked_pose(pose: Array) -> Array:
    pose = np.asarray(pose, dtype=float)
    good = pose.shape == (4, 4) and bool(np.all(np.isfinite(pose)))
    if good:
        turn = pose[:3, :3]
        good = bool(
            np.allclose(turn @ turn.T, np.eye(3), atol=1e-6)
            and np.linalg.det(turn) > 0.0
            and np.allclose(pose[3], (0.0, 0.0, 0.0, 1.0), atol=1e-9)
        )
    if not good:
        raise ValueError(
            f'pose = {pose.tolist()}: must be a rotation and a position, shape (4, 4)'
        )
    return pose


POSES = 2000
"""Number of random poses over the joint ranges that represent the workspace."""

USUAL = 0.8
"""Quantile of the condition numbers of these poses above which MoveIt Servo slows the arm."""

NEARLY_ALL = 0.95
"""Quantile of the condition numbers of these poses above which MoveIt Servo halts the arm."""


def singularity_thresholds(model: RobotModel) -> tuple[float, float]:
    """Return the condition numbers of the Jacobian above which MoveIt Servo slows and halts."""
    limits = model.limits
    random = np.random.default_rng(0)
    shape = (POSES, len(limits.names))
    result = conditions(model, random.uniform(limits.position_min, limits.position_max, shape))
    lower, stop = np.quantile(result, (USUAL, NEARLY_ALL))
    return float(lower), float(stop)


def conditions(model: RobotModel, joints: Array) -> Array:
    """Return the condition numbers of tool0's Jacobian at joints of shape (k, n), shape (k,).

    The condition number is the ratio of the largest to the smallest singular value, inf in a
    singularity. As in MoveIt, m and rad are mixed, so the number depends on the size of the arm,
    and each model needs its own thresholds.
    """
    chain, count = model.chain, len(joints)
    turns = np.broadcast_to(np.eye(3), (count, 3, 3))
    place = np.zeros((count, 3))
    axes, places = [], []
    rows = zip(chain.origins, chain.axes, model.joint_types, joints.T, strict=True)
    for origin, (x, y, z), kind, values in rows:
        place = place + turns @ origin
        axes.append(turns @ np.array([x, y, z]))
        places.append(place)
        if kind == PRISMATIC:
            place = place + axes[-1] * values[:, None]
            continue
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        sine, versed = np.sin(values), 1.0 - np.cos(values)
        turn = np.eye(3) + sine[:, None, None] * cross + versed[:, None, None] * (cross @ cross)
        turns = turns @ turn
    tool = place + turns @ model.tool0.xyz
    columns = [
        np.hstack([axis, np.zeros_like(axis)])
        if kind == PRISMATIC
        else np.hstack([np.cross(axis, tool - place), axis])
        for axis, place, kind in zip(axes, places, model.joint_types, strict=True)
    ]
    values = np.linalg.svd(np.stack(columns, axis=2), compute_uv=False)
    with np.errstate(divide='ignore'):
        return np.asarray(values[:, 0] / values[:, -1])
