# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Validity of setpoints, and the reference that windows, points and velocities define."""

import numpy as np
import pytest
from support.driver_harness import LIMITS, pose
from support.streams import positions, window

from epson_driver.driver.servo.setpoint import Setpoint, Window
from epson_driver.driver.servo.stream import MAX_EXTRAPOLATION_S, StreamReference


def sine(t):
    return pose(0.2 * np.sin(3.0 * t)), pose(0.6 * np.cos(3.0 * t))


def test_window_is_interpolated_between_its_points():
    reference = StreamReference(window(sine, step=0.02), LIMITS)
    assert reference.reach == pytest.approx(0.1)
    for t in np.linspace(0.0, 0.1, 34):
        position, velocity = reference.at(t)
        wanted, speed = sine(t)
        np.testing.assert_allclose(position, wanted, atol=2e-6)
        np.testing.assert_allclose(velocity, speed, atol=2e-3)


def test_past_points_of_a_window_are_interpolated():
    reference = StreamReference(window(sine, begins=-0.1), LIMITS)
    np.testing.assert_allclose(reference.at(-0.05)[0], sine(-0.05)[0], atol=1e-6)
    np.testing.assert_array_equal(reference.at(-9.0)[0], reference.at(-0.1)[0])


def test_window_without_velocities_uses_differences_of_positions():
    whole = window(sine)
    times, positions = whole.window.times, whole.window.positions
    bare = Setpoint(whole.source, whole.positions, None, Window(times, positions))
    position, velocity = StreamReference(bare, LIMITS).at(0.055)
    np.testing.assert_allclose(position, sine(0.055)[0], atol=1e-5)
    np.testing.assert_allclose(velocity, sine(0.055)[1], atol=5e-3)


@pytest.mark.invariant(2)
def test_inv2_last_velocity_is_extrapolated_for_a_limited_time():
    reference = StreamReference(positions(pose(0.1), pose(0.5)), LIMITS)
    np.testing.assert_allclose(reference.at(0.02)[0], pose(0.11))
    far, _ = reference.at(10.0)
    np.testing.assert_allclose(far, pose(0.1 + 0.5 * MAX_EXTRAPOLATION_S))


@pytest.mark.invariant(2)
def test_inv2_huge_values_stay_within_range_and_velocity_limit():
    huge = np.full((3, 6), 1e308)
    times = np.array([0.0, 0.05, 0.1])
    reference = StreamReference(
        Setpoint('x', huge[-1], -huge[-1], Window(times, huge, -huge)), LIMITS
    )
    for t in (-1.0, 0.0, 0.03, 0.1, 5.0):
        position, velocity = reference.at(t)
        assert np.all(np.isfinite(position))
        assert np.all(np.isfinite(velocity))
        within = LIMITS.velocity * MAX_EXTRAPOLATION_S
        assert np.all(position <= LIMITS.position_max + within)
        assert np.all(position >= LIMITS.position_min - LIMITS.velocity * 0.05)


TIMES = np.array([0.0, 0.1])
STILL = np.zeros((2, 6))


def changed(value):
    values = STILL.copy()
    values[0, 2] = value
    return values


@pytest.mark.parametrize(
    ('positions', 'velocities', 'problem'),
    [
        (STILL, None, None),
        (STILL, STILL, None),
        (changed(np.nan), None, 'joint_3: positions = nan is not finite, in point 0'),
        (STILL, changed(np.inf), 'joint_3: velocities = inf is not finite, in point 0'),
        (STILL[:, :5], None, 'positions of shape (2, 5) for 6 joints'),
        (STILL, STILL[:1], 'velocities of shape (1, 6) for 6 joints'),
    ],
)
def test_every_point_of_a_window_is_checked(positions, velocities, problem):
    window = Window(TIMES, positions, velocities)
    assert Setpoint('~/servo', np.zeros(6), window=window).problem(LIMITS) == problem


def test_empty_setpoint_is_refused():
    nothing = Setpoint('~/servo')
    assert nothing.problem(LIMITS) == 'it has neither positions nor velocities'
    assert nothing.beyond(LIMITS, LIMITS.velocity) is None


@pytest.mark.parametrize(
    ('setpoint', 'problem'),
    [
        (
            Setpoint('~/servo', np.zeros(6), changed(10.0)[0]),
            'joint_3: velocity 10 rad/s is above the joint limit, 8.97 rad/s',
        ),
        (
            Setpoint('~/servo', STILL[0], window=Window(np.array([0.0, 1e-9]), changed(0.05))),
            'joint_3: mean velocity between two points -5e+07 rad/s is above the '
            'joint limit, 8.97 rad/s',
        ),
        (
            Setpoint('~/servo', STILL[0], window=Window(TIMES, STILL, STILL + 1.0)),
            'joint_1: its velocities add up to 0.1 rad, but its positions move by 0 rad',
        ),
    ],
    ids=['velocity', 'points too near each other', 'contradiction'],
)
@pytest.mark.invariant(2)
def test_inv2_setpoint_beyond_joint_velocity_is_refused(setpoint, problem):
    assert setpoint.problem(LIMITS) == problem


def test_velocity_setpoint_beyond_limits_is_not_refused():
    assert Setpoint('~/joint_jog', None, np.full(6, 100.0)).problem(LIMITS) is None
