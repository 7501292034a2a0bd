# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Trajectories and tolerances read from ROS messages, and their errors."""

from itertools import permutations

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from control_msgs.msg import JointTolerance
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError
from epson_driver.node.trajectory_messages import tolerances_from_messages, trajectory_from_message

NAMES = ('a', 'b', 'c')


def point(time, positions, velocities=(), accelerations=()):
    sec, fraction = divmod(time, 1.0)
    return JointTrajectoryPoint(
        positions=[float(value) for value in positions],
        velocities=[float(value) for value in velocities],
        accelerations=[float(value) for value in accelerations],
        time_from_start=Duration(sec=int(sec), nanosec=round(fraction * 1e9)),
    )


def message(*points, names=NAMES):
    return JointTrajectory(joint_names=list(names), points=list(points))


def good(count=3):
    return [point(index, (0.1 * index, 0.2 * index, 0.3 * index)) for index in range(count)]


def rejection(call, code=ErrorCode.INVALID_GOAL):
    with pytest.raises(GoalRejectedError) as caught:
        call()
    assert caught.value.code is code
    assert caught.value.outcome.end is End.ABORTED
    assert caught.value.outcome.code is code
    assert caught.value.outcome.text == str(caught.value)
    return str(caught.value)


def from_message(*args, **kwargs):
    return lambda: trajectory_from_message(message(*args, **kwargs), NAMES)


@pytest.mark.parametrize('names', list(permutations(NAMES)), ids=''.join)
def test_names_may_come_in_any_order(names):
    values = dict(zip(NAMES, (0.1, 0.2, 0.3), strict=True))
    ordered = [values[name] for name in names]
    trajectory = trajectory_from_message(
        message(point(0.0, ordered, ordered, ordered), names=names), NAMES
    )
    assert trajectory.joint_names == NAMES
    assert trajectory.positions.tolist() == [[0.1, 0.2, 0.3]]
    assert trajectory.velocities.tolist() == [[0.1, 0.2, 0.3]]
    assert trajectory.accelerations.tolist() == [[0.1, 0.2, 0.3]]


@pytest.mark.parametrize(
    ('names', 'words'),
    [
        (('a', 'b', 'b'), ['b twice']),
        (('a', 'b'), ['lacks c']),
        (('b',), ['lacks a, c']),
        ((), ['lacks a, b, c']),
        (('a', 'b', 'c', 'd'), ["unknown joints in joint_names: 'd'"]),
        (('a', 'b', 'C'), ['lacks c', "'C'"]),
        (('a', 'b', ''), ['lacks c', "''"]),
    ],
)
def test_wrong_joint_names_are_named_in_the_error(names, words):
    zeros = [0.0] * len(names)
    text = rejection(from_message(point(0.0, zeros), names=names), ErrorCode.INVALID_JOINTS)
    assert all(word in text for word in words)


def test_trajectory_without_points_is_rejected():
    assert 'no points' in rejection(from_message())


@pytest.mark.parametrize(
    ('points', 'text'),
    [
        ([point(0, (1, 2))], 'point 0: 2 positions for 3 joints'),
        ([point(0, (1, 2, 3, 4))], 'point 0: 4 positions for 3 joints'),
        ([point(0, ())], 'point 0: 0 positions for 3 joints'),
        ([*good(2), point(2, ())], 'point 2: 0 positions for 3 joints'),
        ([*good(1), point(1, (0, 0, 0), (0, 0))], 'point 0: 0 velocities for 3 joints'),
        (
            [point(0, (0, 0, 0), (0, 0, 0)), point(1, (0, 0, 0), (0,))],
            'point 1: 1 velocities for 3 joints',
        ),
        ([point(0, (0, 0, 0), (), (0, 0))], 'point 0: 2 accelerations for 3 joints'),
        ([*good(1), point(1, (0, 0)), point(2, (0,) * 4)], 'point 1: 2 positions for 3 joints'),
    ],
)
def test_arrays_of_wrong_length_are_rejected(points, text):
    assert text in rejection(from_message(*points))


def test_error_codes_equal_the_action_s_codes():
    from control_msgs.action import FollowJointTrajectory

    result = FollowJointTrajectory.Result
    for code in ErrorCode:
        assert getattr(result, code.name) == code


DEFAULTS = np.array([0.01, 0.02, 0.0])


def tolerances(**positions):
    entries = [JointTolerance(name=name, position=value) for name, value in positions.items()]
    return tolerances_from_messages(entries, 'goal_tolerance', NAMES, DEFAULTS)


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
    entries = [JointTolerance(name='x', position=0.1)]
    text = rejection(
        lambda: tolerances_from_messages(entries, 'path_tolerance', NAMES, DEFAULTS),
        ErrorCode.INVALID_JOINTS,
    )
    assert "path_tolerance names the unknown joint 'x'" in text


def test_goal_without_tolerances_and_defaults_is_not_checked():
    assert not tolerances_from_messages([], 'path_tolerance', NAMES, np.zeros(3)).checked
