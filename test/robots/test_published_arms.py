# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The models compared with all arms of EPSON's ROS 2 package."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from epson_driver.motion import Array
from epson_driver.robots import RobotModel, load_robot_model, robot_models
from epson_driver.robots.kinematics import Kinematics

PUBLISHED: dict[str, dict[str, Any]] = yaml.safe_load(
    Path(__file__).with_name('published_arms.yaml').read_text('utf-8')
)
each = pytest.mark.parametrize('name', PUBLISHED)

CLOSE_M = 1e-6
CLOSE_DIRECTION = 2e-5
"""Tolerance, rad. EPSON's last frames are turned by 1.57079 instead of π/2."""

ROUNDED = 1e-6
"""Relative tolerance, because the numbers have four or five decimals."""


def numbers(text: object) -> Array:
    return np.array(str(text).split(), dtype=float)


def model(name: str) -> RobotModel:
    return load_robot_model(name)


def test_every_arm_published_by_epson_has_a_model() -> None:
    assert len(PUBLISHED) == 64
    assert {name.lower().replace('-', '_') for name in PUBLISHED} <= set(robot_models())


@each
def test_tool_pose_of_each_model_equals_the_pose_in_epsons_urdf(name: str) -> None:
    arm = Kinematics(model(name))
    for joints, pose in PUBLISHED[name]['poses'].items():
        expected = numbers(pose).reshape(3, 3)
        result = arm.in_base(arm.forward(numbers(joints)))
        np.testing.assert_allclose(result[:3, 3], expected[0], rtol=0, atol=CLOSE_M)
        np.testing.assert_allclose(
            result[:3, [0, 2]].T, expected[1:], rtol=0, atol=CLOSE_DIRECTION
        )


@each
def test_joint_ranges_are_close_to_epsons_and_within(name: str) -> None:
    ours = model(name)
    published = np.array([numbers(item) for item in PUBLISHED[name]['range'].split(';')])
    low = ours.limits.position_min * ours.shown_per_unit
    high = ours.limits.position_max * ours.shown_per_unit
    for inwards in (low - published[:, 0], published[:, 1] - high):
        assert np.all(inwards >= -1e-5)
        assert np.all(inwards <= 0.01)


@each
def test_speeds_and_accelerations_do_not_exceed_epsons(name: str) -> None:
    ours = model(name)
    speed = ours.limits.velocity * ours.shown_per_unit / numbers(PUBLISHED[name]['speed'])
    hard = ours.limits.acceleration / numbers(PUBLISHED[name]['acceleration'])
    for fraction, least in ((speed, 0.9998), (hard, 0.995)):
        assert np.all(fraction <= 1.0 + ROUNDED), fraction
        assert np.all(fraction >= least), fraction


@each
def test_values_published_by_epson_are_marked_confirmed(name: str) -> None:
    provenance = model(name).provenance
    assert {provenance[key].worst for key in ('range', 'speed', 'acceleration', 'origins')} == {
        'confirmed'
    }
