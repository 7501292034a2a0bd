# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A goal's tolerances override the configured ones."""

import numpy as np
import pytest
from control_msgs.msg import JointTolerance

from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.node.trajectory_messages import tolerances_from_messages

NAMES = ('a', 'b', 'c')
DEFAULTS = np.array([0.01, 0.02, 0.0])


def tolerances(**positions):
    entries = [JointTolerance(name=name, position=value) for name, value in positions.items()]
    return tolerances_from_messages(entries, 'goal_tolerance', NAMES, DEFAULTS)


def rejection(entry):
    with pytest.raises(GoalRejectedError) as caught:
        tolerances_from_messages([entry], 'path_tolerance', NAMES, DEFAULTS)
    return caught.value.code, str(caught.value)


@pytest.mark.parametrize(
    ('requested', 'expected'),
    [
        ({}, [0.01, 0.02, np.inf]),
        ({'a': 0.0}, [0.01, 0.02, np.inf]),
        ({'a': 0.5}, [0.5, 0.02, np.inf]),
        ({'c': 0.3}, [0.01, 0.02, 0.3]),
        ({'b': -1.0}, [0.01, np.inf, np.inf]),
        ({'c': 0.0, 'a': -0.1}, [np.inf, 0.02, np.inf]),
    ],
)
def test_zero_tolerance_means_default_and_negative_means_unchecked(requested, expected):
    assert tolerances(**requested).position.tolist() == expected
    assert DEFAULTS.tolist() == [0.01, 0.02, 0.0]  # unchanged for the next goal


def test_velocity_tolerances_have_no_default():
    result = tolerances_from_messages(
        [
            JointTolerance(name='a', velocity=0.5),
            JointTolerance(name='b', velocity=-1.0),
        ],
        'path_tolerance',
        NAMES,
        np.zeros(3),
    )
    assert result.velocity.tolist() == [0.5, np.inf, np.inf]
    assert result.position.tolist() == [np.inf] * 3


def test_unknown_joint_is_rejected():
    code, text = rejection(JointTolerance(name='x', position=0.1))
    assert code is ErrorCode.INVALID_JOINTS
    assert "path_tolerance names the unknown joint 'x'" in text


def test_goal_without_tolerances_and_defaults_is_not_checked():
    assert not tolerances_from_messages([], 'path_tolerance', NAMES, np.zeros(3)).checked
