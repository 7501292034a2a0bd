# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Jogging: directions, speeds, steps and refusals."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from epson_driver.motion import Trajectory
from epson_driver.motion.interpolation import Interpolation
from epson_driver.panel.jog import (
    DIRECTIONS,
    JOINT_FRACTION,
    STEP_FRACTION,
    TOOL_M_S,
    TOOL_RAD_S,
    Jog,
)
from epson_driver.panel.robot_state import RequestError
from epson_driver.robots import load_robot_model
from epson_driver.robots.chain import rotation_about

C3 = Jog(load_robot_model('c3_a601s'))
SCARA = Jog(load_robot_model('gx8_c652s'))
BENT = np.array([0.3, -0.2, 0.4, 0.5, -0.9, 0.2])
FOLDED = np.array([0.5, 0.9, -0.1, 0.3])

ARMS = [(C3, BENT), (SCARA, FOLDED)]
MOTIONS = [
    (jog, joints, axis, frame)
    for jog, joints in ARMS
    for axis in jog.axes
    for frame in ('world', 'tool')
]


def frame_of(jog: Jog, joints: np.ndarray, frame: str) -> np.ndarray:
    pose = jog.model.base.matrix if frame == 'world' else jog.kinematics.forward(joints)
    return np.asarray(pose[:3, :3])


@pytest.mark.parametrize(('jog', 'joints', 'axis', 'frame'), MOTIONS)
def test_tool_moves_along_or_turns_about_the_axis(
    jog: Jog, joints: np.ndarray, axis: str, frame: str
) -> None:
    fraction, time = 0.05, 1e-4
    moving = jog.velocities(joints, axis, frame, fraction)
    before, after = (jog.kinematics.forward(q) for q in (joints, joints + time * moving))
    turns, direction = DIRECTIONS[axis]
    along = frame_of(jog, joints, frame) @ direction
    turn = (after[:3, :3] @ before[:3, :3].T - np.eye(3)) / time
    turned = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
    moved = (after[:3, 3] - before[:3, 3]) / time
    assert_allclose(moved, np.zeros(3) if turns else fraction * TOOL_M_S * along, atol=1e-4)
    assert_allclose(turned, fraction * TOOL_RAD_S * along if turns else np.zeros(3), atol=1e-4)


@pytest.mark.parametrize(('jog', 'joints'), ARMS)
@pytest.mark.invariant(2)
def test_joint_speed_limit_preserves_the_direction(jog: Jog, joints: np.ndarray) -> None:
    random = np.random.default_rng(5)
    low, high = jog.model.limits.position_min, jog.model.limits.position_max
    allowed = JOINT_FRACTION * jog.model.limits.velocity * (1.0 + 1e-9)
    for _ in range(200):
        joints = random.uniform(0.9 * low, 0.9 * high)
        axis = random.choice(jog.axes)
        try:
            fast, slow = (jog.velocities(joints, axis, 'world', item) for item in (1.0, 1e-3))
        except RequestError:
            continue  # singular there, or at the end of a range
        assert np.all(np.abs(fast) <= allowed)
        norms = np.linalg.norm(fast) * np.linalg.norm(slow)
        assert fast @ slow == pytest.approx(norms, rel=1e-6)


def test_single_joint_moves_in_both_directions() -> None:
    for sign in (1.0, -1.0):
        wanted = np.zeros(6)
        wanted[2] = sign * 0.4 * JOINT_FRACTION * C3.model.limits.velocity[2]
        assert_allclose(C3.velocities(BENT, '3', 'world', sign * 0.4), wanted)


@pytest.mark.invariant(2)
def test_joint_at_the_end_of_its_range_only_moves_back() -> None:
    joints = BENT.copy()
    joints[0] = C3.model.limits.position_max[0] - 1e-4
    with pytest.raises(RequestError, match='joint_1 is at the end of its range'):
        C3.velocities(joints, '1', 'world', 0.1)
    assert C3.velocities(joints, '1', 'world', -0.1)[0] < 0.0
    with pytest.raises(RequestError, match='joint_1 is at the end of its range'):
        C3.step(joints, '1', 'world', 0.01, 1.0)
    limits = C3.model.limits
    joints[0] = limits.position_max[0] + 0.5 * limits.rounding[0]
    assert C3.step(joints, '1', 'world', -0.1, 1.0).positions[0, 0] == limits.position_max[0]


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    ('axis', 'size', 'text'),
    [
        *((axis, 0.1, 'has no axis') for axis in ('0', '7', '', 'Q', '²', '9' * 20)),
        *((axis, size, 'step = ') for axis, size in (('X', 0.2), ('1', 1), ('U', -0.6), ('X', 0))),
    ],
)
def test_unknown_axis_and_zero_or_too_large_step_are_refused(
    axis: str, size: float, text: str
) -> None:
    with pytest.raises(RequestError, match=text):
        C3.step(BENT, axis, 'world', size, 1.0)


def test_singular_direction_is_refused() -> None:
    """With joint 5 straight, joints 4 and 6 turn about one axis."""
    straight = np.array([0.3, -0.2, 0.4, 0.0, 0.0, 0.0])
    with pytest.raises(
        RequestError, match='cannot move in this direction from here: move a joint first'
    ):
        C3.velocities(straight, 'W', 'tool', 0.1)


def assert_slow(trajectory: Trajectory, jog: Jog, share: float) -> None:
    limits = jog.model.limits
    times = np.linspace(0.0, trajectory.duration, 500)
    curve = Interpolation(trajectory.times, trajectory.positions, trajectory.velocities)
    _, velocities, accelerations = curve.at(times)
    assert np.all(np.abs(velocities) <= 1.02 * share * STEP_FRACTION * limits.velocity)
    assert np.all(np.abs(accelerations) <= 1.5 * share * STEP_FRACTION * limits.acceleration)
    assert trajectory.velocities is not None
    assert_allclose(trajectory.velocities[[0, -1]], 0.0, atol=1e-9)


@pytest.mark.parametrize(('jog', 'joints', 'axis', 'frame'), MOTIONS)
@pytest.mark.invariant(2)
def test_tool_step_is_straight_slow_and_exact(
    jog: Jog, joints: np.ndarray, axis: str, frame: str
) -> None:
    turns, direction = DIRECTIONS[axis]
    size = np.radians(5.0) if turns else -0.01
    trajectory = jog.step(joints, axis, frame, size, 0.5)
    start, end = (jog.kinematics.forward(trajectory.positions[k]) for k in (0, -1))
    along = frame_of(jog, joints, frame) @ direction
    place = start[:3, 3] + (0.0 if turns else size) * along
    turn = rotation_about(along, size) if turns else np.eye(3)
    assert_allclose(end[:3, 3], place, atol=1e-6)
    assert_allclose(end[:3, :3], turn @ start[:3, :3], atol=1e-6)
    for q in trajectory.positions:
        off = jog.kinematics.forward(q)[:3, 3] - start[:3, 3]
        off -= (off @ along) * along * (not turns)
        assert np.linalg.norm(off) < 2e-5
    assert_slow(trajectory, jog, 0.5)


@pytest.mark.invariant(2)
def test_joint_steps_and_motions_to_points_are_slow() -> None:
    trajectory = C3.step(BENT, '2', 'world', np.radians(10.0), 1.0)
    assert_allclose(trajectory.positions[-1] - BENT, np.radians([0, 10.0, 0, 0, 0, 0]), atol=1e-9)
    assert_slow(trajectory, C3, 1.0)
    assert_slow(C3.straight(BENT, np.zeros(6)), C3, 1.0)


def test_unreachable_pose_is_refused() -> None:
    folded = np.array([0.5, 0.02, -0.1, 0.3])
    away = SCARA.kinematics.forward(folded)[:3, 3]
    axis, size = ('X', 0.1 * np.sign(away[0])) if abs(away[0]) > abs(away[1]) else ('Y', 0.1)
    with pytest.raises(RequestError, match='cannot reach this pose on a straight line'):
        SCARA.step(folded, axis, 'world', size, 1.0)
