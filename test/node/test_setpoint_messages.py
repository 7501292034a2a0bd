# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Valid and invalid setpoint messages, for example from MoveIt Servo."""

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from control_msgs.msg import JointJog
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.driver.servo.setpoint import Mode
from epson_driver.node.servo_interface import (
    SetpointError,
    from_jog,
    from_joint_state,
    from_positions,
    from_trajectory,
    from_velocities,
)
from epson_driver.robots import load_robot_model

NAMES = tuple('abcdef')
NOW = 1000.0
VALUES = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]


def time_of(kind, seconds):
    whole = math.floor(seconds)
    return kind(sec=whole, nanosec=round((seconds - whole) * 1e9))


def window(ends=0.1, points=20, names=NAMES, velocities=True, begin=NOW - 0.1):
    """Return a message like MoveIt Servo's: stamp of the first point, and the points."""
    message = JointTrajectory(joint_names=list(names))
    message.header.stamp = time_of(Time, begin) if begin else Time()
    length = NOW + ends - begin if begin else ends
    for fraction in np.linspace(0.0, 1.0, points) if points > 1 else [1.0]:
        message.points.append(
            JointTrajectoryPoint(
                positions=[float(fraction) * value for value in VALUES],
                velocities=VALUES if velocities else [],
                time_from_start=time_of(Duration, fraction * length),
            )
        )
    return message


def test_setpoint_window_keeps_future_points_and_the_last_past_one():
    setpoint = from_trajectory(window(points=21), NAMES, 'x', NOW)
    assert setpoint.mode is Mode.POSITION
    np.testing.assert_array_equal(setpoint.positions, VALUES)
    np.testing.assert_array_equal(setpoint.velocities, VALUES)
    times = setpoint.window.times
    assert len(times) == 11
    assert times[0] <= 0.0 < times[1]
    np.testing.assert_allclose(times, np.arange(11) * 0.01, atol=1e-6)
    fractions = np.linspace(0.5, 1.0, 11)
    np.testing.assert_allclose(setpoint.window.positions, np.outer(fractions, VALUES))
    np.testing.assert_allclose(setpoint.window.velocities, np.tile(VALUES, (11, 1)))
    message = window()
    message.points[-2].velocities = []
    assert from_trajectory(message, NAMES, 'x', NOW).window.velocities is None
    assert from_trajectory(window(ends=-0.01), NAMES, 'x', NOW).window is None


def stuck(message):
    """Give the last two points the same time."""
    message.points[-2].time_from_start = message.points[-1].time_from_start
    return message


def gap(message):
    message.points[-2].positions = []
    return message


@pytest.mark.parametrize('begin', [NOW - 0.02, 0.0], ids=['stamped', 'stamp 0'])
def test_single_point_keeps_its_velocities(begin):
    setpoint = from_trajectory(window(0.02, points=1, begin=begin), NAMES, 'x', NOW)
    np.testing.assert_array_equal(setpoint.positions, VALUES)
    np.testing.assert_array_equal(setpoint.velocities, VALUES)


def test_setpoint_with_velocities_only_is_a_velocity_setpoint():
    message = window(points=1)
    message.points[-1].positions = []
    setpoint = from_trajectory(message, NAMES, 'x', NOW)
    assert setpoint.mode is Mode.VELOCITY


def test_joints_may_come_in_any_order():
    message = window(names=NAMES[::-1])
    np.testing.assert_array_equal(
        from_trajectory(message, NAMES, 'x', NOW).positions, VALUES[::-1]
    )


def test_joint_state_with_and_without_velocities_is_read():
    state = JointState(name=list(NAMES), position=VALUES)
    assert from_joint_state(state, NAMES, 'x').velocities is None
    state.velocity = VALUES
    np.testing.assert_array_equal(from_joint_state(state, NAMES, 'x').velocities, VALUES)
    state.position = []
    assert from_joint_state(state, NAMES, 'x').mode is Mode.VELOCITY


def test_arrays_of_forward_command_controllers_are_read():
    message = Float64MultiArray(data=VALUES)
    np.testing.assert_array_equal(from_positions(message, NAMES, 'x').positions, VALUES)
    np.testing.assert_array_equal(from_velocities(message, NAMES, 'x').velocities, VALUES)


def test_jog_moves_only_the_named_joints():
    setpoint = from_jog(JointJog(joint_names=['c', 'a'], velocities=[0.3, -0.1]), NAMES, 'x')
    np.testing.assert_array_equal(setpoint.velocities, [-0.1, 0.0, 0.3, 0.0, 0.0, 0.0])
    assert not setpoint.at_rest
    assert from_jog(JointJog(joint_names=['a'], velocities=[0.0]), NAMES, 'x').at_rest


def short(message):
    message.points[-1].positions = VALUES[:3]
    return message


@pytest.mark.parametrize(
    ('read', 'text'),
    [
        (lambda: from_trajectory(window(3.0), NAMES, 'x', NOW), 'send long trajectories'),
        (lambda: from_trajectory(window(), NAMES, 'x', NOW + 60.0), 'was 59.9 s ago'),
        (lambda: from_trajectory(window(), NAMES, 'x', NOW - 60.0), 'synchronise the clocks'),
        (lambda: from_trajectory(short(window()), NAMES, 'x', NOW), '3 values in positions'),
        (lambda: from_trajectory(stuck(window()), NAMES, 'x', NOW), 'does not increase'),
        (lambda: from_trajectory(gap(window()), NAMES, 'x', NOW), 'some of its points have no'),
        (lambda: from_trajectory(window(points=2000), NAMES, 'x', NOW), 'more than 500 points'),
        (lambda: from_trajectory(window(names='abcdex'), NAMES, 'x', NOW), "unknown joint 'x'"),
        (lambda: from_trajectory(window(names='abcdea'), NAMES, 'x', NOW), 'twice'),
        (
            lambda: from_joint_state(JointState(name=['a']), NAMES, 'x'),
            'joints b, c, d, e, f are missing',
        ),
        (lambda: from_joint_state(JointState(name=list(NAMES)), NAMES, 'x'), 'neither'),
        (lambda: from_positions(Float64MultiArray(data=[0.0]), NAMES, 'x'), '1 values in data'),
        (lambda: from_velocities(Float64MultiArray(), NAMES, 'x'), 'neither'),
        (lambda: from_jog(JointJog(joint_names=['a'], displacements=[1.0]), NAMES, 'x'), 'displ'),
        (lambda: from_jog(JointJog(joint_names=['a']), NAMES, 'x'), '0 velocities for 1'),
        (lambda: from_jog(JointJog(joint_names=['z'], velocities=[1.0]), NAMES, 'x'), "'z'"),
    ],
)
def test_invalid_setpoint_message_is_rejected(read, text):
    with pytest.raises(SetpointError, match=text):
        read()


def test_nan_velocity_is_found_by_the_driver():
    message = JointJog(joint_names=['a'], velocities=[math.nan])
    problem = from_jog(message, NAMES, 'x').problem(load_robot_model('c3_a601s').limits)
    assert problem == 'joint_1: velocities = nan is not finite'
