# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""KDL with the configured parameters keeps the tool's rotation, as LIN and CIRC require.

MoveIt's KDL plugin iterates with the pseudo-inverse of the Jacobian, with position_only_ik of its
upper half, until the error is below `epsilon`. This file does the same with numpy.
"""

import numpy as np
import pytest
import yaml
from support.examples import one_in

from epson_driver.motion import Array
from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.chain import PRISMATIC, rotation_about
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.model import SCARA
from epson_driver.share import share_path

EPSILON = 1e-5
"""The plugin's default, m or rad."""

MAX_STEPS = 500
"""The plugin's max_solver_iterations."""

SCARAS = [name for name in robot_models() if load_robot_model(name).kind == SCARA]


def configured_rows() -> int:
    text = share_path('config', 'moveit', 'kinematics_scara.yaml').read_text(encoding='utf-8')
    return 3 if yaml.safe_load(text)['manipulator']['position_only_ik'] else 6


def twist(begin: Array, end: Array) -> Array:
    """Return the translation, m, and rotation, rad, between two poses, in base."""
    turn = end[:3, :3] @ begin[:3, :3].T
    sine = 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    length = float(np.linalg.norm(sine))
    angle = np.arctan2(length, 0.5 * (np.trace(turn) - 1.0))
    return np.concatenate([end[:3, 3] - begin[:3, 3], sine * (angle / length if length else 1.0)])


def jacobian(arm: Kinematics, joints: Array) -> Array:
    frames, tool = arm.link_frames(joints), arm.forward(joints)[:3, 3]
    columns = []
    model = arm.model
    for frame, axis, kind in zip(frames, model.chain.axes, model.joint_types, strict=True):
        along = frame[:3, :3] @ axis
        if kind == PRISMATIC:
            columns.append(np.concatenate([along, np.zeros(3)]))
        else:
            columns.append(np.concatenate([np.cross(along, tool - frame[:3, 3]), along]))
    return np.array(columns).T


def solved(arm: Kinematics, pose: Array, seed: Array, rows: int) -> Array | None:
    joints = seed
    for _ in range(MAX_STEPS):
        away = twist(arm.forward(joints), pose)
        if max(np.linalg.norm(away[:3]), np.linalg.norm(away[3:rows])) <= EPSILON:
            return joints
        joints = joints + np.linalg.pinv(jacobian(arm, joints)[:rows]) @ away[:rows]
    return None


def ready(arm: Kinematics) -> tuple[Array, Array]:
    """Return tool0 and joints of the SRDF's non-singular pose."""
    shown = np.array([45.0, 90.0, -50.0, 0.0]) / arm.model.shown_per_unit
    return arm.forward(shown), shown


@pytest.mark.parametrize('name', one_in(12, SCARAS))
def test_line_is_followed_with_constant_tool_rotation(name: str) -> None:
    arm = Kinematics(load_robot_model(name))
    start, joints = ready(arm)
    reach = float(arm.model.reach[0])
    for fraction in np.linspace(0.0, 1.0, 21):
        pose = start.copy()
        pose[:3, 3] += fraction * 0.2 * reach * np.array([-0.6, 0.6, 0.1])
        pose[:3, :3] = rotation_about(np.array([0.0, 0.0, 1.0]), fraction * 0.5) @ start[:3, :3]
        result = solved(arm, pose, joints, configured_rows())
        assert result is not None
        assert np.linalg.norm(twist(arm.forward(result), pose)) < 2 * EPSILON
        assert np.abs(result - joints).max() < 0.3
        joints = result
    assert np.all(joints >= arm.model.limits.position_min)
    assert np.all(joints <= arm.model.limits.position_max)


def test_tilted_pose_of_a_scara_has_no_solution() -> None:
    arm = Kinematics(load_robot_model('gx8_c652s'))
    pose, seed = ready(arm)
    pose[:3, :3] = rotation_about(np.array([1.0, 0.0, 0.0]), 1e-3) @ pose[:3, :3]
    assert solved(arm, pose, seed, configured_rows()) is None
