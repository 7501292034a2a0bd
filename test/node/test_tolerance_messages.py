# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Tolerances of a goal over the configured ones."""

from itertools import product

import numpy as np
import pytest
from control_msgs.msg import JointTolerance

from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.node.trajectory_messages import tolerances_from_messages

NAMES = ('a', 'b', 'c')
DEFAULTS = np.array([0.01, 0.02, 0.0])


def asked_for(**positions):
    entries = [JointTolerance(name=name, position=value) for name, value in positions.items()]
    return tolerances_from_messages(entries, 'goal_tolerance', NAMES, DEFAULTS)


def rejection(entry):
    with pytest.raises(GoalRejectedError) as caught:
        tolerances_from_messages([entry], 'path_tolerance', NAMES, DEFAULTS)
    return caught.value.code, str(caught.value)


@pytest.mark.parametrize(
    ('asked', 'expected'),
    [
        ({}, [0.01, 0.02, np.inf]),
        ({'a': 0.0}, [0.01, 0.02, np.inf]),
        ({'a': 0.5}, [0.5, 0.02, np.inf]),
        ({'c': 0.3}, [0.01, 0.02, 0.3]),
        ({'b': -1.0}, [0.01, np.inf, np.inf]),
        ({'c': 0.0, 'a': -0.1}, [np.inf, 0.02, np.inf]),
    ],
)
def test_zero_is_the_default_and_negative_is_off(asked, expected):
    assert asked_for(**asked).position.tolist() == expected
    assert DEFAULTS.tolist() == [0.01, 0.02, 0.0]  # not changed for the next goal


def test_velocities_have_no_default():
    made = tolerances_from_messages(
        [
            JointTolerance(name='a', velocity=0.5),
            JointTolerance(name='b', velocity=-1.0),
        ],
        'path_tolerance',
        NAMES,
        np.zeros(3),
    )
    assert made.velocity.tolist() == [0.5, np.inf, np.inf]
    assert made.position.tolist() == [np.inf] * 3


def test_an_unknown_joint():
    code, text = rejection(JointTolerance(name='x', position=0.1))
    assert code is ErrorCode.INVALID_JOINTS
    assert "path_tolerance names the unknown joint 'x'" in text


@pytest.mark.parametrize(
    ('quantity', 'value'),
    list(product(('position', 'velocity', 'acceleration'), (float('nan'), float('inf')))),
)
def test_what_is_not_finite(quantity, value):
    code, text = rejection(JointTolerance(name='b', **{quantity: value}))
    assert code is ErrorCode.INVALID_GOAL
    assert f'path_tolerance, b: {quantity}' in text


def test_a_limit_of_the_acceleration_is_refused_and_none_is_not():
    code, text = rejection(JointTolerance(name='b', acceleration=1.0))
    assert code is ErrorCode.INVALID_GOAL
    assert 'reports no accelerations' in text
    off = JointTolerance(name='b', acceleration=-1.0)
    assert tolerances_from_messages([off], 'path_tolerance', NAMES, DEFAULTS).position[1] == 0.02


def test_nothing_is_checked_where_nothing_is_limited():
    assert not tolerances_from_messages([], 'path_tolerance', NAMES, np.zeros(3)).checked
