# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The inverse kinematics of SCARAs, for every model that is one."""

import numpy as np
import pytest

from epson_driver.robots import load_robot_model, robot_models
from epson_driver.robots.chain import rotation_about
from epson_driver.robots.kinematics import Kinematics
from epson_driver.robots.opw import KinematicsError
from epson_driver.robots.scara import SCARA, ScaraKinematics, kinematics_of

MODELS = [name for name in robot_models() if load_robot_model(name).kind == SCARA]


@pytest.mark.parametrize('name', MODELS)
def test_inverse_finds_what_forward_came_from_and_only_solutions(name):
    model = load_robot_model(name)
    arm = kinematics_of(model)
    assert isinstance(arm, ScaraKinematics)
    chance = np.random.default_rng(5)
    low, high = model.limits.position_min, model.limits.position_max
    for _ in range(50):
        joints = chance.uniform(low, high)
        pose = arm.forward(joints)
        found = arm.inverse(pose, joints)
        assert np.abs(found[0] - joints).max() < 1e-7
        assert np.all((found >= low) & (found <= high))
        for each in found:
            assert np.abs(arm.forward(each) - pose).max() < 1e-6


def test_both_elbows_are_found_and_the_nearest_one_comes_first():
    arm = kinematics_of(load_robot_model('gx4_c251s'))
    joints = np.array([0.5, 0.8, -0.05, 0.3])
    found = arm.inverse(arm.forward(joints), joints)
    assert {bool(each[1] > 0.0) for each in found} == {True, False}
    other = next(each for each in found if each[1] < 0.0)
    assert np.array_equal(arm.inverse(arm.forward(joints), other)[0], other)


def test_what_is_out_of_reach_or_tilted_has_no_solution():
    arm = kinematics_of(load_robot_model('gx4_c251s'))
    pose = arm.forward(np.zeros(4))
    far, high, tilted = pose.copy(), pose.copy(), pose.copy()
    far[:2, 3] *= 3.0
    high[2, 3] += 1.0
    tilted[:3, :3] = pose[:3, :3] @ rotation_about(np.array([1.0, 0.0, 0.0]), 0.1)
    for each in (far, high, tilted):
        assert len(arm.inverse(each)) == 0


def test_other_arms_are_solved_as_ever():
    six = load_robot_model('c3_a601s')
    assert type(kinematics_of(six)) is Kinematics
    with pytest.raises(KinematicsError, match='c3_a601s: it is no SCARA'):
        ScaraKinematics(six).inverse(np.eye(4))
