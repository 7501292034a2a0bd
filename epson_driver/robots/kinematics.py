# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Forward and inverse kinematics of Tool 0, or of a tool that is mounted on it.

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
"""Rounding tolerance at the ends of a joint's range, rad or m."""

SAME_SOLUTION_RAD = 1e-5
"""Maximum difference of joints between solutions that are merged, as for a stretched arm."""

GIMBAL_LOCK_RAD = 1e-6
"""Maximum distance from ±π/2 at which EPSON's angle V counts as ±π/2."""


class Solver(Protocol):
    """A closed-form solution for one kind of chain. Its poses are poses of tool0 in base_link."""

    def branches(self, pose: Array, near: Array) -> list[Array]:
        """Return all solutions for a pose, including solutions beyond the joint limits.

        In a singularity, `near` selects one of the possible solutions.
        """

    def why_unreachable(self, pose: Array, /) -> str:
        """Return why the orientation of a pose is unreachable, or ''."""

    def sides(self, joints: Array, /) -> tuple[float, ...]:
        """Return a number for each choice of configuration (see `Kinematics.sides`)."""


class Kinematics:
    """Forward and inverse kinematics of one model, from its data. Joints have shape (n,), rad, m.

    All poses are poses of `tool`, which is given by its own pose in tool0, shape (4, 4), m (None:
    tool0 itself).

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

        The k results, shape (k, n), are sorted by their distance from `near` (default: all joints
        0). If a joint can turn more than once, each full turn is a separate result. k is 0 if the
        pose is out of reach. In a wrist singularity, joint 4 has the value in `near`. If a
        six-axis arm's wrist, or a SCARA's folded arm, is on joint 1's axis, joint 1 has the value
        in `near`.

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
        """Return a number for each choice of the arm's configuration. The sign is the choice.

        A SCARA has one number, the position of joint 2, rad. A six-axis arm has three: the
        distance of the wrist in front of joint 1's axis, m, the upward bend of the elbow, rad, and
        the bend of the wrist, rad. Raises KinematicsError if the arm has no closed-form inverse
        kinematics.
        """
        return self._solver.sides(self._checked(joints))

    def in_base(self, pose: Array) -> Array:
        return np.asarray(np.linalg.inv(self._world) @ pose)

    def from_base(self, pose: Array) -> Array:
        return np.asarray(self._world @ pose)

    def epson_point(self, joints: Array) -> tuple[Array, Array]:
        """Return the tool's position and orientation as the teach pendant shows them.

        The position is X, Y, Z, m, and the orientation is U, V, W, rad.
        """
        pose = self.in_base(self.forward(joints))
        return pose[:3, 3], uvw(pose[:3, :3])

    @cached_property
    def _solver(self) -> Solver:
        if self.model.kind == SCARA:
            return ScaraSolver(self.model)
        return OpwSolver(self.model)

    def _of_tool0(self, pose: Array) -> Array:
        return np.asarray(pose @ self._from_tool)

    def _turns(self, branch: Array) -> list[Array]:
        """Return all variants of a solution.

        The variants differ by full turns of joints whose ranges exceed one turn.
        """
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
    """Return EPSON's angles U, V, W of a rotation matrix, rad.

    U is about Z, V about the new Y, and W about the new X. U and W are in [-π, π], V in [-π/2,
    π/2]. If V is ±π/2, U is 0.
    """
    r = np.asarray(rotation, dtype=float)
    across = float(np.hypot(r[0, 0], r[1, 0]))
    v = np.arctan2(-r[2, 0], across)
    if across > GIMBAL_LOCK_RAD:
        return np.array([np.arctan2(r[1, 0], r[0, 0]), v, np.arctan2(r[2, 1], r[2, 2])])
    return np.array([0.0, v, np.arctan2(-r[1, 2], r[1, 1])])


def rotation_of_uvw(angles: Array) -> Array:
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
"""Number of random poses that represent the workspace, spread over the joint ranges."""

USUAL = 0.8
"""Quantile of the poses' condition numbers above which MoveIt Servo slows the arm."""

NEARLY_ALL = 0.95
"""Quantile of the poses' condition numbers above which MoveIt Servo halts the arm."""


def singularity_thresholds(model: RobotModel) -> tuple[float, float]:
    """Return the condition numbers of the Jacobian above which MoveIt Servo slows and halts."""
    limits = model.limits
    random = np.random.default_rng(0)
    shape = (POSES, len(limits.names))
    result = conditions(model, random.uniform(limits.position_min, limits.position_max, shape))
    lower, stop = np.quantile(result, (USUAL, NEARLY_ALL))
    return float(lower), float(stop)


def conditions(model: RobotModel, joints: Array) -> Array:
    """Return the condition number of tool0's Jacobian at each of k joint positions, shape (k,).

    `joints` has the shape (k, n). As in MoveIt, m and rad are mixed, so each model needs its own
    thresholds. At a singularity the result is inf.
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
