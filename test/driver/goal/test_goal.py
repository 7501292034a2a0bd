# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reasons for rejecting a goal, and the texts of violated tolerances."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from epson_driver.driver.goal.goal import (
    MAX_MENTIONED_PROBLEMS,
    Tolerances,
    check_limits,
    check_start,
)
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError
from epson_driver.driver.remedy import Remedy
from epson_driver.motion import JointLimits, Trajectory

NAMES = ('a', 'b', 'c')
LIMITS = JointLimits(
    NAMES,
    np.array([-1.0, -2.0, -3.0]),
    np.array([1.0, 2.0, 3.0]),
    np.array([1.0, 2.0, 3.0]),
    np.array([10.0, 10.0, 10.0]),
    np.array([100.0, 100.0, 100.0]),
)


def point(time, positions, velocities=(), accelerations=()):
    return SimpleNamespace(
        time=time,
        positions=list(positions),
        velocities=list(velocities),
        accelerations=list(accelerations),
    )


def trajectory_of(*points):
    quantities = ('positions', 'velocities', 'accelerations')
    columns = ([getattr(item, name) for item in points] for name in quantities)
    given = [np.array(column, dtype=float) if column[0] else None for column in columns]
    return Trajectory(NAMES, np.array([float(item.time) for item in points]), *given)


def checked(*points, **options):
    check_limits(trajectory_of(*points), LIMITS, **options)


def rejection(call, code=ErrorCode.INVALID_GOAL):
    with pytest.raises(GoalRejectedError) as caught:
        call()
    assert caught.value.code is code
    assert caught.value.outcome.end is End.ABORTED
    assert caught.value.outcome.code is code
    assert caught.value.outcome.text == str(caught.value)
    return str(caught.value)


# --- numbers ----------------------------------------------------------------------------------


def test_single_violation_is_reported_alone():
    text = rejection(lambda: checked(point(0, (0, 0, 0)), point(9, (0, 2.5, 0))))
    assert ';' not in text


def test_first_violations_are_listed_and_others_counted():
    points = [point(9 * t, (0, 5, 0)) for t in range(20)]
    text = rejection(lambda: checked(*points))
    assert text.count('point ') == MAX_MENTIONED_PROBLEMS
    assert text.endswith(f'and {20 - MAX_MENTIONED_PROBLEMS} more')
    exactly = [point(9 * t, (0, 5, 0)) for t in range(MAX_MENTIONED_PROBLEMS)]
    assert 'more' not in rejection(lambda: checked(*exactly))


def test_end_velocity_is_rejected_unless_allowed():
    points = [point(0, (0, 0, 0), (0, 0, 0)), point(1, (0.1, 0, 0), (0, 0.2, 0))]
    with pytest.raises(GoalRejectedError, match=r'point 1, b: .*0\.2 rad/s') as caught:
        checked(*points)
    assert caught.value.outcome.remedy is Remedy.ALLOW_END_VELOCITY
    checked(*points, may_end_moving=True)


# --- the start --------------------------------------------------------------------------------


def starting(time, positions):
    return trajectory_of(point(time, positions))


def test_start_beyond_tolerance_is_rejected_with_joint_and_positions():
    trajectory = starting(0, (0.0, 0.5, 0.0))
    text = rejection(lambda: check_start(trajectory, np.array([0.0, 0.1, 0.0]), LIMITS, 0.02))
    assert text.startswith('b: ')
    assert 'starts at 0.5 rad' in text
    assert 'is at 0.1 rad' in text
    assert '0.4 rad apart' in text
    assert 'limit is 0.02 rad' in text
    assert 'a:' not in text


def test_start_is_rejected_if_the_arm_cannot_reach_it_by_its_time():
    check_start(starting(0.5, (0.5, 1.0, 1.5)), np.zeros(3), LIMITS, 0.02)
    trajectory = starting(0.5, (0.6, 0.0, 0.0))
    text = rejection(lambda: check_start(trajectory, np.zeros(3), LIMITS, 0.02))
    assert '1.2 rad/s' in text
    assert 'limit is 1 rad/s' in text


@pytest.mark.parametrize(
    ('angles', 'seen'),
    [
        ((45.0, -30.0, 20.0), True),
        ((0.5, 0.0, 90.0), True),
        ((4.0, 0.0, 0.0), False),  # more than the limit, less than a turn
        ((0.5, 0.0, 9.0), False),  # less than two turns
        ((0.0, 0.0, 9000.0), False),  # too much as degrees, too
    ],
)
def test_hint_about_degrees_is_given_once_and_only_if_plausible(angles, seen):
    with pytest.raises(GoalRejectedError) as caught:
        checked(point(0, (0, 0, 0)), point(90, angles), point(180, angles))
    text = str(caught.value)
    assert 'position' in text
    assert 'is outside the limits' in text
    if seen:
        assert text.count('outside') == 1
        assert text.endswith('rad; these look like degrees: positions are in rad')
    else:
        assert 'degrees' not in text


@pytest.mark.invariant(2)
def test_angles_beyond_a_turn_are_accepted_within_limits():
    wide = replace(LIMITS, position_min=np.full(3, -40.0), position_max=np.full(3, 40.0))
    trajectory = Trajectory(
        LIMITS.names, np.array([0.0, 100.0]), np.array([[0.0, 0.0, 0.0], [7.0, 0.0, -30.0]])
    )
    check_limits(trajectory, wide)


def test_tolerance_violation_names_worst_joint_error_and_limit():
    limits = Tolerances(np.array([0.1, 0.1, np.inf]), np.array([np.inf, 1.0, np.inf]))
    still = np.zeros(3)
    assert limits.checked
    assert limits.violation(NAMES, np.array([0.1, -0.1, 9.0]), still) is None
    text = limits.violation(NAMES, np.array([0.2, -0.3, 9.0]), still)
    assert text == 'b: the position error is 0.3 rad, the tolerance is 0.1 rad'
    text = limits.violation(NAMES, still, np.array([5.0, -1.5, 5.0]))
    assert text == 'b: the velocity error is 1.5 rad/s, the tolerance is 1 rad/s'
