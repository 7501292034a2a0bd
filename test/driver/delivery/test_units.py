# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Texts about a prismatic joint use metres, those about a revolute joint rad."""

import re

import numpy as np
import pytest

from epson_driver.driver.goal.goal import Tolerances, check_start
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.motion import Trajectory, go, problems
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.condition.errors import angles_rejection

MODEL = load_robot_model('gx4_c251s')
LIMITS = MODEL.limits
HOME = np.array([0.1, 0.2, -0.05, 0.3])


def plan(*points, times=(0.0, 1.0), **fields):
    return Trajectory(MODEL.joint_names, np.array(times), np.array(points), **fields)


def moved(joint, by):
    target = HOME.copy()
    target[joint] += by
    return target


@pytest.mark.parametrize(
    ('joint', 'by', 'unit', 'limits'),
    [(2, 0.1, 'm', '-0.15 … 0'), (3, 9.0, 'rad', '-6.28319 … 6.28319')],
)
def test_error_about_a_position_out_of_range_has_the_joint_s_unit(joint, by, unit, limits):
    problem = next(problems(plan(HOME, moved(joint, by)), LIMITS))
    value = f'{HOME[joint] + by:.6g}'
    name = f'joint_{joint + 1}'
    assert problem == (
        f'point 1, {name}: position {value} {unit} is outside the limits {limits} {unit}'
    )
    rejection = angles_rejection(moved(joint, by), LIMITS)
    assert re.search(rf'^{name} = {value} {unit} is outside .* {unit}$', rejection.sentence)
    with pytest.raises(ValueError, match=rf'{name}: target .* {unit}$'):
        go(LIMITS, HOME, moved(joint, by))


@pytest.mark.parametrize(('joint', 'unit'), [(2, 'm'), (3, 'rad')])
def test_error_about_a_distant_start_has_the_joint_s_unit(joint, unit):
    name = f'joint_{joint + 1}'
    with pytest.raises(GoalRejectedError) as caught:
        check_start(plan(HOME, HOME), moved(joint, -0.05), LIMITS, 0.02)
    assert f'0.05 {unit} apart, the limit is 0.02 {unit}' in str(caught.value)
    late = plan(HOME, HOME, times=(1e-4, 1.0))
    with pytest.raises(GoalRejectedError, match=rf'{name}: .* need 500 {unit}/s, .* {unit}/s$'):
        check_start(late, moved(joint, -0.05), LIMITS, 0.02)


def test_error_about_a_violated_tolerance_has_the_joint_s_unit():
    allowed = Tolerances(np.full(4, 0.01), np.full(4, 0.1))
    off = np.zeros(4)
    off[2] = 0.02
    units = LIMITS.units.__getitem__
    assert allowed.violation(MODEL.joint_names, off, np.zeros(4), units) == (
        'joint_3: the position error is 0.02 m, the tolerance is 0.01 m'
    )
    assert allowed.violation(MODEL.joint_names, np.zeros(4), off * 10, units) == (
        'joint_3: the velocity error is 0.2 m/s, the tolerance is 0.1 m/s'
    )
