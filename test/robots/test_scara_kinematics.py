# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The closed-form inverse of SCARAs, checked with forward kinematics and at its limits."""

import dataclasses

import numpy as np
import pytest
from support.examples import one_in

from epson_driver.robots import Chain, load_robot_model, robot_models
from epson_driver.robots.kinematics import Kinematics, rotation_of_uvw
from epson_driver.robots.opw import KinematicsError
from epson_driver.robots.scara import scara_parameters

MODELS = [model for model in map(load_robot_model, robot_models()) if model.kind == 'SCARA']
GX4 = load_robot_model('gx4_c251s')
RS4 = load_robot_model('rs4_c351s')


def hanging(model):
    """Return a model upside down, with a tool off its last axis and inverted axes."""
    turned = Chain(model.chain.origins * (1.0, 1.0, -1.0), -model.chain.axes)
    tool0 = dataclasses.replace(model.tool0, xyz=np.array([0.01, -0.02, -0.03]))
    return dataclasses.replace(model, name='hanging', chain=turned, tool0=tool0)


@pytest.mark.parametrize(
    'model', one_in(12, [hanging(GX4), *MODELS]), ids=lambda model: model.name
)
def test_inverse_returns_the_original_joints_and_valid_solutions(model):
    arm, limits = Kinematics(model), model.limits
    random = np.random.default_rng(18)
    both = 0
    for joints in random.uniform(limits.position_min, limits.position_max, (60, 4)):
        pose = arm.forward(joints)
        result = arm.inverse(pose, joints)
        assert np.abs(result[0] - joints).max() < 1e-6
        for solution in result:
            np.testing.assert_allclose(arm.forward(solution), pose, atol=1e-9)
            assert np.all((solution >= limits.position_min) & (solution <= limits.position_max))
        sides = {float(np.sign(np.sin(solution[1]))) for solution in result}
        both += len(sides) == 2
    assert both > 10  # most poses can be reached with the elbow on either side


def test_arm_lengths_equal_the_chain():
    lengths = scara_parameters(GX4).lengths
    assert lengths == pytest.approx({'arm_1': 0.124, 'arm_2': 0.126, 'height': 0.124})


@pytest.mark.parametrize(('model', 'bend'), [(GX4, 0.0), (RS4, np.pi)], ids=['gx4', 'rs4'])
def test_stretched_arm_has_one_solution_and_none_beyond(model, bend):
    arm = Kinematics(model)
    stretched = np.array([0.7, bend, -0.05, 0.2])
    pose = arm.forward(stretched)
    result = arm.inverse(pose, stretched)
    assert np.abs(result[0] - stretched).max() < 1e-6
    for beyond, count in ((1e-6, True), (1e-5, False)):
        further = pose.copy()
        away = pose[:2, 3] / np.linalg.norm(pose[:2, 3])
        further[:2, 3] += beyond * away
        assert bool(len(arm.inverse(further, stretched))) is count


@pytest.mark.parametrize('name', ['t6_602s', 'n2_a450s'])
def test_taught_point_of_a_stretched_arm_is_reachable(name):
    model = load_robot_model(name)
    arm, joints = Kinematics(model), np.zeros(len(model.joint_names))
    for joints[0] in np.linspace(0.0, 1.0, 40):
        place, angles = arm.epson_point(joints)
        rounded = np.eye(4)  # as RC+ stores it
        rounded[:3, 3] = np.round(place * 1e3, 3) / 1e3
        rounded[:3, :3] = rotation_of_uvw(np.radians(np.round(np.degrees(angles), 3)))
        result = arm.inverse(arm.from_base(rounded), joints)[0]
        np.testing.assert_allclose(arm.forward(result), arm.from_base(rounded), atol=1e-5)


def test_folded_scara_with_equal_arms_keeps_joint_1():
    arm = Kinematics(RS4)
    folded = np.array([0.4, 0.0, -0.05, 0.2])  # at zero one arm is below the other
    result = arm.inverse(arm.forward(folded), folded)
    assert np.abs(result[0] - folded).max() < 1e-6


def test_inverse_respects_the_range_of_the_shaft():
    arm = Kinematics(GX4)
    pose = arm.forward(np.array([0.3, 0.8, -0.1, 0.0]))
    assert len(arm.inverse(pose))
    for height in (0.11, -0.051):
        pose[2, 3] += height
        assert not len(arm.inverse(pose))
        pose[2, 3] -= height


def test_tilted_tool_is_refused_with_the_reason():
    arm = Kinematics(GX4)
    pose = arm.forward(np.array([0.3, 0.8, -0.1, 0.0]))
    assert arm.why_unreachable(pose) == ''
    pose[:3, :3] = pose[:3, :3] @ rotation_of_uvw(np.radians([0.0, 0.0, 3.0]))
    assert not len(arm.inverse(pose))
    assert arm.why_unreachable(pose) == (
        'it is tilted by 3 degrees, but a SCARA tool stays upright'
    )
    upside_down = arm.forward(np.zeros(4))
    upside_down[:3, :3] = upside_down[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    assert 'is tilted by 180 degrees' in arm.why_unreachable(upside_down)


def test_chain_that_is_no_scara_is_refused_with_the_reason():
    axes = GX4.chain.axes.copy()
    axes[1] = [0.0, 1.0, 0.0]
    leaning = dataclasses.replace(GX4, chain=Chain(GX4.chain.origins, axes))
    with pytest.raises(KinematicsError, match=r'^gx4_c251s: .*: the axis of joint_2 is not vert'):
        Kinematics(leaning).inverse(np.eye(4))
    origins = GX4.chain.origins.copy()
    origins[1] = 0.0
    short = dataclasses.replace(GX4, chain=Chain(origins, GX4.chain.axes))
    with pytest.raises(KinematicsError, match='one of its arms has no length'):
        Kinematics(short).inverse(np.eye(4))
