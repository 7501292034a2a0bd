# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Forward and inverse kinematics, checked against known poses, Pinocchio and each other."""

import dataclasses
import re

import numpy as np
import numpy.typing as npt
import pytest
from check_points import CHECK_POINTS, CLOSE
from scipy.spatial.transform import Rotation
from support.examples import one_in

from epson_driver.robots import Chain, Frame, RobotModel, load_robot_model, robot_models
from epson_driver.robots.kinematics import Kinematics, rotation_of_uvw, uvw
from epson_driver.robots.opw import KinematicsError, opw_parameters
from epson_driver.robots.urdf import urdf

pinocchio = pytest.importorskip('pinocchio')
Array = npt.NDArray[np.float64]

C3 = load_robot_model('c3_a601s')
MODELS = [load_robot_model(name) for name in robot_models()]
SIX_AXIS = [model for model in MODELS if model.kind == 'six-axis']
EXACT = 1e-9


def ceiling(model: RobotModel) -> RobotModel:
    """Return a ceiling variant: heights and axes 1, 2, 3 and 5 are negated."""
    origins = model.chain.origins * (1.0, 1.0, -1.0)
    axes = model.chain.axes * np.array([[-1, -1, -1, 1, -1, 1]]).T
    return dataclasses.replace(model, name=model.name + 'r', chain=Chain(origins, axes))


ARMS = [*SIX_AXIS, ceiling(load_robot_model('c8_c901s'))]


def names(value: object) -> str | None:
    return value.name if isinstance(value, RobotModel) else None


def joints_of(model: RobotModel, seed: int, count: int) -> Array:
    limits = model.limits
    shape = (count, len(model.joint_names))
    return np.random.default_rng(seed).uniform(limits.position_min, limits.position_max, shape)


def turned(one: Array, other: Array) -> float:
    """Return the angle between two rotations, degrees."""
    return float(np.degrees(Rotation.from_matrix(one.T @ other).magnitude()))


@pytest.mark.parametrize(('degrees', 'millimetres', 'angles'), CHECK_POINTS)
def test_tool0_equals_the_pose_of_the_pendant(
    degrees: tuple[float, ...],
    millimetres: tuple[float, ...],
    angles: tuple[float, ...] | None,
) -> None:
    arm = Kinematics(C3)
    place, shown = arm.epson_point(np.radians(degrees))
    assert place * 1e3 == pytest.approx(millimetres, abs=CLOSE)
    if angles is not None:
        # compared as rotations, because 180 equals -180 degrees
        assert turned(rotation_of_uvw(shown), rotation_of_uvw(np.radians(angles))) < CLOSE
        if abs(angles[1]) == 90:
            assert np.degrees(shown) == pytest.approx(angles, abs=CLOSE)


def from_urdf(text: str, degrees: tuple[float, ...]) -> Array:
    """Return Tool 0 in base, computed by Pinocchio from the URDF."""
    read = pinocchio.buildModelFromXML(text)
    data = read.createData()
    pinocchio.framesForwardKinematics(read, data, np.radians(degrees))
    base, tool = (data.oMf[read.getFrameId(name)] for name in ('base', 'tool0'))
    return np.asarray((base.inverse() * tool).homogeneous)


@pytest.mark.parametrize(('degrees', 'millimetres', 'angles'), CHECK_POINTS)
def test_tool0_of_the_urdf_equals_the_pose_of_the_pendant(
    degrees: tuple[float, ...],
    millimetres: tuple[float, ...],
    angles: tuple[float, ...] | None,
) -> None:
    pose = from_urdf(urdf('c3_a601s'), degrees)
    assert pose[:3, 3] * 1e3 == pytest.approx(millimetres, abs=CLOSE)
    if angles is not None:
        assert turned(pose[:3, :3], rotation_of_uvw(np.radians(angles))) < CLOSE


@pytest.mark.parametrize('model', one_in(6, SIX_AXIS), ids=names)
def test_chain_in_python_equals_the_urdf(model: RobotModel) -> None:
    read = pinocchio.buildModelFromXML(urdf(model.file))
    data, arm = read.createData(), Kinematics(model)
    for joints in joints_of(model, 0, 50):
        pinocchio.framesForwardKinematics(read, data, joints)
        frames = arm.link_frames(joints)
        for number, frame in enumerate(frames, start=1):
            there = data.oMf[read.getFrameId(f'link_{number}')].homogeneous
            np.testing.assert_allclose(frame, there, atol=EXACT)
        there = data.oMf[read.getFrameId('tool0')].homogeneous
        np.testing.assert_allclose(arm.forward(joints), there, atol=EXACT)
        in_base = data.oMf[read.getFrameId('base')].inverse().homogeneous @ there
        np.testing.assert_allclose(arm.in_base(arm.forward(joints)), in_base, atol=EXACT)
        np.testing.assert_allclose(arm.from_base(in_base), there, atol=EXACT)


def test_opw_lengths_of_the_c3_are_the_published_values() -> None:
    result = opw_parameters(C3)
    assert list(result.lengths) == ['a1', 'a2', 'b', 'c1', 'c2', 'c3', 'c4']
    assert list(result.lengths.values()) == pytest.approx(
        (0.100, 0.0, 0.0, 0.320, 0.250, 0.250, 0.065), abs=1e-12
    )
    assert result.signs == (1, -1, -1, -1, -1, -1)
    offsets = np.array(result.offsets)
    offsets[5] = abs(offsets[5])  # half a turn in either direction
    assert offsets == pytest.approx([0, 0, -np.pi / 2, 0, 0, np.pi], abs=1e-12)


def test_c8_has_an_elbow_offset() -> None:
    result = opw_parameters(load_robot_model('c8_c901s'))
    assert list(result.lengths) == ['a1', 'a2', 'b', 'c1', 'c2', 'c3', 'c4']
    assert list(result.lengths.values()) == pytest.approx(
        (0.1, -0.03, 0.0, 0.472, 0.4, 0.4, 0.08), abs=1e-12
    )


@pytest.mark.parametrize('model', one_in(6, ARMS), ids=names)
def test_inverse_returns_the_original_joints_first(
    model: RobotModel,
) -> None:
    arm, limits = Kinematics(model), model.limits
    for joints in joints_of(model, 2, 40):
        pose = arm.forward(joints)
        result = arm.inverse(pose, joints)
        np.testing.assert_allclose(result[0], joints, atol=1e-6)
        assert np.all(result >= limits.position_min)
        assert np.all(result <= limits.position_max)
        distances = np.linalg.norm(result - joints, axis=1)
        assert np.all(np.diff(distances) >= -EXACT)
        for other in result:
            np.testing.assert_allclose(arm.forward(other), pose, atol=EXACT)


@pytest.mark.parametrize('model', one_in(3, ARMS), ids=names)
def test_inverse_finds_every_solution_within_limits(model: RobotModel) -> None:
    """Expected: the flipped wrist and full turns of the known solution."""
    arm, limits = Kinematics(model), model.limits
    missed = 0
    for joints in joints_of(model, 3, 20):
        result = arm.inverse(arm.forward(joints))
        for flip in (0, 1):
            for fourth in (-2, -1, 0, 1, 2):
                for sixth in (-3, -2, -1, 0, 1, 2, 3):
                    other = joints.copy()
                    other[3] += np.pi * (2 * fourth + flip)
                    other[4] *= -1.0 if flip else 1.0
                    other[5] += np.pi * (2 * sixth + flip)
                    inside = (limits.position_min <= other) & (other <= limits.position_max)
                    near = np.all(np.abs(result - other) < 1e-6, axis=1)
                    missed += int(np.all(inside) != np.any(near))
    assert missed == 0


def test_inverse_includes_all_full_turns() -> None:
    arm = Kinematics(C3)
    pose = arm.forward(np.radians([10.0, -20.0, 30.0, 170.0, 40.0, 50.0]))
    turns = {
        (round(np.degrees(item[3])), round(np.degrees(item[5]))) for item in arm.inverse(pose)
    }
    assert {(170, 50), (170, -310), (-190, 50), (-190, -310)} <= turns


def test_straight_wrist_keeps_joint_4() -> None:
    arm = Kinematics(C3)
    joints = np.radians([10.0, -20.0, 30.0, 60.0, 0.0, -15.0])
    near = np.radians([10.0, -20.0, 30.0, 100.0, 0.0, 0.0])
    result = arm.inverse(arm.forward(joints), near)
    assert np.degrees(result[0]) == pytest.approx([10, -20, 30, 100, 0, -55], abs=1e-6)
    for other in result:
        np.testing.assert_allclose(arm.forward(other), arm.forward(joints), atol=EXACT)


@pytest.mark.parametrize('model', one_in(3, ARMS), ids=names)
def test_singular_poses_have_solutions_despite_rounding(model: RobotModel) -> None:
    arm = Kinematics(model)
    result = opw_parameters(model)
    # the elbow angle of a straight arm, with the elbow offset
    stretched = result.signs[2] * (
        result.offsets[2] - np.arctan2(result.lengths['a2'], result.lengths['c3'])
    )
    for index, joints in enumerate(joints_of(model, 5, 60)):
        if index % 3 != 1:
            joints[4] = 0.0
        if index % 3 != 2:
            joints[2] = stretched
        pose = arm.forward(joints)
        first = arm.inverse(pose, joints)[0]
        np.testing.assert_allclose(first, joints, atol=1e-4)  # only the pose is well defined
        np.testing.assert_allclose(arm.forward(first), pose, atol=4e-6)


@pytest.mark.parametrize('degrees', [point[0] for point in CHECK_POINTS])
def test_inverse_finds_the_check_points(degrees: tuple[float, ...]) -> None:
    arm, joints = Kinematics(C3), np.radians(degrees)
    pose = arm.forward(joints)
    result = arm.inverse(pose, joints)
    # singularities cost half of the digits
    np.testing.assert_allclose(result[0], joints, atol=1e-5)
    np.testing.assert_allclose(arm.forward(result[0]), pose, atol=4e-6)
    for one in range(len(result)):  # a stretched elbow has no second solution
        others = np.delete(result, one, axis=0)
        assert np.all(np.max(np.abs(others - result[one]), axis=1) > 1e-5)


def test_unreachable_pose_has_no_solution() -> None:
    arm = Kinematics(C3)
    pose = arm.forward(np.zeros(6))
    pose[0, 3] = 2.0
    assert arm.inverse(pose).shape == (0, 6)
    behind = np.radians([0.0, 60.0, 220.0, 0.0, 0.0, 0.0])
    narrow = dataclasses.replace(C3.limits, position_max=np.full(6, 0.1))
    arm = Kinematics(dataclasses.replace(C3, limits=narrow))
    assert arm.inverse(arm.forward(behind)).shape == (0, 6)


@pytest.mark.parametrize(
    'pose',
    [
        np.zeros((4, 4)),
        np.eye(3),
        np.diag([1.0, 1.0, -1.0, 1.0]),
        np.diag([2.0, 0.5, 1.0, 1.0]),
        np.full((4, 4), np.nan),
    ],
)
def test_matrix_that_is_not_a_pose_is_refused(pose: Array) -> None:
    with pytest.raises(ValueError, match=r'^pose = .*: must be a rotation and a position'):
        Kinematics(C3).inverse(pose)


@pytest.mark.parametrize('joints', [[0.0] * 5, [0.0] * 7, [0.0, 0, 0, 0, 0, np.nan], 0.0])
def test_wrong_number_of_joints_is_refused(joints: object) -> None:
    arm = Kinematics(C3)
    with pytest.raises(ValueError, match='must be 6 finite numbers'):
        arm.forward(np.array(joints))
    with pytest.raises(ValueError, match='must be 6 finite numbers'):
        arm.inverse(np.eye(4), np.array(joints))


def changed(
    joint: int, axis: npt.ArrayLike | None = None, origin: npt.ArrayLike | None = None
) -> Chain:
    origins, axes = C3.chain.origins.copy(), C3.chain.axes.copy()
    if axis is not None:
        axes[joint] = np.asarray(axis)
    if origin is not None:
        origins[joint] = np.asarray(origin)
    return Chain(origins, axes)


@pytest.mark.parametrize(
    ('chain', 'reason'),
    [
        (changed(0, axis=(1, 0, 0)), 'the axis of joint 1 is not parallel to z'),
        (changed(1, axis=(0, 0, 1)), 'the axis of joint 2 is not parallel to y'),
        (changed(4, axis=(0, 0.6, 0.8)), 'the axis of joint 5 is not parallel to y'),
        (changed(3, axis=(0, 1, 0)), "the axis of joint 4 is not in the arm's plane"),
        (changed(0, origin=(0.01, 0, 0.2)), 'the axis of joint 1 does not pass through base_link'),
        (changed(2, origin=(0, 0, 0)), 'the upper arm or the hand has no length'),
        (
            changed(5, origin=(0.06, 0, 0.01)),
            'where joints 4, 5 and 6 should meet is 0.01 m off the axis of joint 6',
        ),
        (
            changed(4, origin=(0.25, 0, 0.02)),
            'where joints 4, 5 and 6 should meet is 0.02 m off the axis of joint 4',
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else '',
)
def test_chain_without_closed_form_is_refused_with_the_reason(chain: Chain, reason: str) -> None:
    model = dataclasses.replace(C3, chain=chain)
    with pytest.raises(KinematicsError, match=re.escape(reason)) as error:
        Kinematics(model).inverse(np.eye(4))
    assert str(error.value).startswith('c3_a601s: no inverse kinematics, because it is not')


def test_tool0_off_the_axis_of_joint_6_is_refused() -> None:
    tool0 = Frame(np.array([0.005, 0.001, 0.0]), C3.tool0.rpy)
    with pytest.raises(KinematicsError, match=r'Tool 0 is 0\.001 m off the axis of joint 6'):
        opw_parameters(dataclasses.replace(C3, tool0=tool0))
    tool0 = Frame(C3.tool0.xyz, np.zeros(3))
    with pytest.raises(KinematicsError, match='the z axis of tool0 is not along joint 6'):
        opw_parameters(dataclasses.replace(C3, tool0=tool0))


def test_scara_at_zero_is_stretched_along_the_x_axis_of_epsons_world() -> None:
    model = load_robot_model('gx4_c251s')
    arm = Kinematics(model)
    place, angles = arm.epson_point(np.zeros(4))
    # zero pulses: along EPSON's X, arms of 124 + 126 mm, and Z 0 at the shaft's upper end
    assert place == pytest.approx([0.25, 0.0, 0.0], abs=1e-12)
    assert angles == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    joints = np.array([np.pi / 2, np.pi / 2, -0.1, np.radians(-30.0)])
    place, angles = arm.epson_point(joints)
    assert place == pytest.approx([-0.126, 0.124, -0.1], abs=1e-12)
    assert np.degrees(angles) == pytest.approx([150.0, 0.0, 0.0])


def test_tool_is_relative_to_the_flange() -> None:
    tool = np.eye(4)
    tool[:3, :3] = rotation_of_uvw(np.array([0.3, -0.2, 0.1]))
    tool[:3, 3] = [0.02, 0.0, 0.12]
    flange, arm = Kinematics(C3), Kinematics(C3, tool)
    joints = np.radians([20.0, -20.0, 30.0, 25.0, 15.0, 40.0])
    np.testing.assert_allclose(arm.forward(joints), flange.forward(joints) @ tool, atol=EXACT)
    np.testing.assert_allclose(arm.inverse(arm.forward(joints), joints)[0], joints, atol=1e-8)


def test_uvw_rotate_about_z_then_y_then_x() -> None:
    random = np.random.default_rng(4)
    for angles in random.uniform([-np.pi, -1.5, -np.pi], [np.pi, 1.5, np.pi], (200, 3)):
        rotation = rotation_of_uvw(angles)
        same = Rotation.from_euler('ZYX', angles).as_matrix()
        np.testing.assert_allclose(rotation, same, atol=1e-14)
        np.testing.assert_allclose(uvw(rotation), angles, atol=1e-12)
    for v in (np.pi / 2, -np.pi / 2):
        for u, w in random.uniform(-np.pi, np.pi, (50, 2)):
            rotation = rotation_of_uvw(np.array([u, v, w]))
            shown = uvw(rotation)
            assert shown[0] == 0.0
            assert turned(rotation_of_uvw(shown), rotation) < 1e-6


@pytest.mark.parametrize('name', ['c8_c901s', 'cx4_a601s', 'cx7_a701s', 'n2_a450s'])
def test_ceiling_arm_has_the_sides_of_the_standing_arm(name):
    standing, hanging = (load_robot_model(item) for item in (name, f'{name}r'))
    limits = standing.limits
    for joints in np.random.default_rng(3).uniform(
        limits.position_min, limits.position_max, (50, 6)
    ):
        sides = Kinematics(standing).sides(joints)
        assert Kinematics(hanging).sides(joints) == pytest.approx(sides)


@pytest.mark.parametrize('name', ['c3_a601s', 'gx8_c652s', 'n2_a450s'])
def test_jacobian_is_the_derivative_of_the_pose(name):
    model = load_robot_model(name)
    tool = np.eye(4)
    tool[:3, 3] = 0.05, -0.02, 0.1
    arm = Kinematics(model, tool)
    joints = 0.5 * (model.limits.position_min + model.limits.position_max) + 0.3
    step = 1e-6
    for index, column in enumerate(arm.jacobian(joints).T):
        change = step * np.eye(len(joints))[index]
        before, after = arm.forward(joints - change), arm.forward(joints + change)
        turn = after[:3, :3] @ before[:3, :3].T
        about = (turn - turn.T)[[2, 0, 1], [1, 2, 0]] / 2.0
        moved = np.concatenate([after[:3, 3] - before[:3, 3], about]) / (2.0 * step)
        np.testing.assert_allclose(column, moved, atol=1e-8)


NEAR = {'six-axis': 0.995, 'SCARA': 0.999}
"""Fraction of the reach that the tool must attain in some pose."""


@pytest.mark.parametrize('name', one_in(25, robot_models()))
def test_reach_is_a_tight_upper_bound(name: str) -> None:
    model = load_robot_model(name)
    arm = Kinematics(model)
    types = model.joint_types
    random = np.random.default_rng(0)
    bends = np.array([0.0, np.pi / 2, -np.pi / 2, np.pi])
    most = np.zeros(len(types))
    for number in range(600):  # every second pose has right angles only, where extremes are
        angles = random.uniform(-np.pi, np.pi, len(types))
        if number % 2:
            angles = random.choice(bends, len(types))
            angles[2:3] += random.uniform(-0.5, 0.5, 1)  # elbows with an offset
        for joint, kind in enumerate(types):
            if kind == 'prismatic':
                angles[joint] = model.limits.position_min[joint]
        frames = arm.link_frames(angles)
        tool = arm.forward(angles)[:3, 3]
        for joint, kind in enumerate(types):
            axis = frames[joint, :3, :3] @ model.chain.axes[joint]
            away = axis if kind == 'prismatic' else np.cross(axis, tool - frames[joint, :3, 3])
            most[joint] = max(most[joint], float(np.linalg.norm(away)))
    assert np.all(most <= model.reach + 1e-12)
    assert np.all(most >= NEAR[model.kind] * model.reach - 1e-12)


def test_reach_of_the_c3_is_the_sum_of_its_lengths() -> None:
    model = load_robot_model('c3_a601s')
    # 100, 250 and 250 mm to the wrist (the published 600 mm), and 65 mm to the flange
    np.testing.assert_allclose(model.reach, [0.665, 0.565, 0.315, 0.065, 0.065, 0.0], atol=1e-12)
