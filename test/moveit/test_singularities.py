# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""MoveIt Servo's singularity thresholds and start pose, for every model."""

from xml.etree import ElementTree

import numpy as np
import pytest
from support.examples import one_in

from epson_driver.bringup import servo_parameters
from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.kinematics import Kinematics, conditions, singularity_thresholds
from epson_driver.robots.urdf import srdf

each = pytest.mark.parametrize('name', one_in(5, robot_models()))


@each
def test_start_pose_is_far_from_singularities(name: str) -> None:
    model = load_robot_model(name)
    root = ElementTree.fromstring(srdf(name))
    (ready,) = (item for item in root.findall('group_state') if item.get('name') == 'ready')
    joints = np.array([[float(item.get('value', 'nan')) for item in ready.findall('joint')]])
    lower, stop = singularity_thresholds(model)
    assert conditions(model, joints)[0] < 0.7 * lower
    assert 1.0 < lower < stop < np.inf


@pytest.mark.parametrize('name', ['c3_a601s', 'c8_c1401sr', 'gx8_c552s', 'rs6_c552s'])
def test_jacobian_condition_equals_its_numerical_value(name: str) -> None:
    model = load_robot_model(name)
    arm, limits, step = Kinematics(model), model.limits, 1e-6
    for joints in np.random.default_rng(1).uniform(
        0.9 * limits.position_min, 0.9 * limits.position_max, (5, len(limits.names))
    ):
        here, columns = arm.forward(joints), []
        for joint in range(len(joints)):
            there = arm.forward(joints + step * np.eye(len(joints))[joint])
            turn = there[:3, :3] @ here[:3, :3].T
            spin = (turn - turn.T)[[2, 0, 1], [1, 2, 0]] / 2.0
            columns.append(np.concatenate([there[:3, 3] - here[:3, 3], spin]) / step)
        expected = np.linalg.cond(np.array(columns).T)
        assert conditions(model, joints[None])[0] == pytest.approx(expected, rel=1e-3)


def test_straight_wrist_is_singular() -> None:
    model = load_robot_model('c3_a601s')
    _, stop = singularity_thresholds(model)
    assert conditions(model, np.zeros((1, 6)))[0] > stop


def test_servo_parameters_have_the_thresholds_of_the_model() -> None:
    lower, stop = singularity_thresholds(load_robot_model('c8_c901s'))
    servo = servo_parameters('c8_c901s')['moveit_servo']
    assert servo['lower_singularity_threshold'] == lower
    assert servo['hard_stop_singularity_threshold'] == stop
