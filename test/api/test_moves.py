# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Argument checks of joint moves, and the plans made from them."""

import inspect

import numpy as np
import pytest
from support.driver_harness import LIMITS

from epson_driver import Robot
from epson_driver.api import moves
from epson_driver.driver.goal.goal import check_limits
from epson_driver.driver.goal.reference import ReferenceTrajectory
from epson_driver.motion import Trajectory
from epson_driver.motion.point_to_point import LONGEST_SEGMENT_S, straight
from epson_driver.robots import load_robot_model

HOME = np.zeros(6)


@pytest.mark.invariant(1, 2)
@pytest.mark.parametrize(
    ('target', 'expected'),
    [
        ([0.0] * 5, r'target has shape \(1, 5\)'),
        ([0.0] * 7, r'target has shape \(1, 7\)'),
        ([0, 0, float('nan'), 0, 0, 0], 'target.0.: joint_3 = nan: must be a finite'),
        ([0, 0, 0, 0, 0, float('inf')], 'target.0.: joint_6 = inf: must be a finite'),
        ([0, 0, 0, 0, 9.0, 0], 'joint_5: position 9 rad is outside the limits'),
        (['a'] * 6, 'target: must be rows of numbers'),
        (None, 'target'),
    ],
)
def test_invalid_target_is_rejected_with_joint_value_and_limit(target, expected):
    with pytest.raises(ValueError, match=expected):
        moves.targets('target', [target], LIMITS)


def test_joint_values_in_degrees_are_rejected_with_a_hint():
    with pytest.raises(ValueError, match='these look like degrees'):
        moves.targets('target', [[10.0, 20.0, -10.0, 0.0, 45.0, 0.0]], LIMITS)
    with pytest.raises(ValueError, match='these look like degrees'):
        moves.targets('start', [[0, 90, 0, 0, 0, 0]], LIMITS)  # the limit is 65 degrees
    with pytest.raises(ValueError, match='outside the limits') as caught:
        moves.targets('target', [[1e4, 0, 0, 0, 0, 0]], LIMITS)
    assert 'degrees' not in str(caught.value)


def test_joint_values_in_millimetres_are_rejected_with_a_hint():
    limits = load_robot_model('t6_602s').limits
    with pytest.raises(
        ValueError, match=r'joint_3: position -50 m .*; these look like millimetres'
    ):
        moves.targets('target', [[0.0, 0.0, -50.0, 0.0]], limits)
    with pytest.raises(ValueError, match='outside the limits') as caught:
        moves.targets('target', [[0.0, 0.0, -0.5, 0.0]], limits)
    assert 'millimetres' not in str(caught.value)


@pytest.mark.parametrize('name', ['move_joints', 'move_waypoints'])
def test_default_speed_and_acceleration_are_low(name):
    defaults = inspect.signature(getattr(Robot, name)).parameters
    assert defaults['speed'].default <= 0.25
    assert defaults['acceleration'].default <= 0.5


@pytest.mark.parametrize('jerk', [0.0, -1.0, float('nan'), 'high'])
def test_invalid_jerk_is_rejected_and_a_valid_one_used(jerk):
    with pytest.raises(ValueError, match='jerk = '):
        moves.tool_limits(0.1, 2.0, 1.0, 10.0, 1e-4, jerk=jerk, slow=True)
    assert moves.tool_limits(0.1, 2.0, 1.0, 10.0, 1e-4, jerk=5.0, slow=True).jerk_ratio == 2.5


@pytest.mark.invariant(2)
@pytest.mark.parametrize('model', ['c3_a601s', 'gx4_c251s', 'c12_c1401s'])
@pytest.mark.parametrize('sampled', [False, True])
def test_random_moves_respect_the_scaled_limits(model, sampled):
    limits = load_robot_model(model).limits
    random = np.random.default_rng(18)
    for _ in range(30):
        start, target = random.uniform(
            limits.position_min, limits.position_max, (2, len(limits.names))
        )
        speed, acceleration = random.uniform(0.05, 1.0, 2)
        move = straight(start, target, limits, speed, acceleration, sampled=sampled)
        check_limits(move, limits.scaled(speed, acceleration))
        assert np.diff(move.times, prepend=0.0).max() <= LONGEST_SEGMENT_S + 1e-9
        assert np.allclose(move.positions[-1], target)


@pytest.mark.parametrize('velocities', [False, True])
@pytest.mark.parametrize('first', [0.0, 2.0])
def test_long_segment_is_divided_without_changing_the_path(first, velocities):
    start = np.full(6, 0.1)
    times = np.array([first, first + 0.3, first + 1.9])
    positions = np.array([start if first == 0.0 else HOME, HOME + 0.2, HOME + 0.5])
    speeds = np.array([HOME, HOME + 0.3, HOME]) if velocities else None
    plan = Trajectory(LIMITS.names, times, positions, speeds)
    result = moves.divided(plan, start)
    assert np.diff(result.times, prepend=0.0).max() <= LONGEST_SEGMENT_S + 1e-9
    assert set(times) <= set(result.times.tolist())
    before, after = ReferenceTrajectory(plan, start), ReferenceTrajectory(result, start)
    for time in np.linspace(0.0, plan.duration, 50):
        assert np.allclose(before.at(time)[0], after.at(time)[0], atol=1e-9)
    assert moves.divided(result, start) is result
