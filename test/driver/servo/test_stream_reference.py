# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a setpoint, and where setpoints lead: windows, points, velocities."""

import numpy as np
import pytest
from support.driver_harness import HOME, LIMITS, pose
from support.streams import positions, window

from epson_driver.driver.servo.setpoint import Setpoint, Window
from epson_driver.driver.servo.stream import MAX_EXTRAPOLATION_S, StreamReference


def sine(t):
    return pose(0.2 * np.sin(3.0 * t)), pose(0.6 * np.cos(3.0 * t))


def test_a_window_is_followed_between_its_points():
    reference = StreamReference(window(sine, step=0.02), LIMITS)
    assert reference.reach == pytest.approx(0.1)
    for t in np.linspace(0.0, 0.1, 34):
        position, velocity = reference.at(t)
        wanted, speed = sine(t)
        np.testing.assert_allclose(position, wanted, atol=2e-6)
        np.testing.assert_allclose(velocity, speed, atol=2e-3)


def test_what_has_passed_counts_where_it_is_needed():
    reference = StreamReference(window(sine, begins=-0.1), LIMITS)
    np.testing.assert_allclose(reference.at(-0.05)[0], sine(-0.05)[0], atol=1e-6)
    np.testing.assert_array_equal(reference.at(-9.0)[0], reference.at(-0.1)[0])


def test_a_window_without_velocities_has_those_of_its_positions():
    whole = window(sine)
    times, ways = whole.window.times, whole.window.positions
    bare = Setpoint(whole.source, whole.positions, None, Window(times, ways))
    position, velocity = StreamReference(bare, LIMITS).at(0.055)
    np.testing.assert_allclose(position, sine(0.055)[0], atol=1e-5)
    np.testing.assert_allclose(velocity, sine(0.055)[1], atol=5e-3)


@pytest.mark.invariant(2)
def test_inv2_the_last_velocity_goes_on_only_until_the_next_message_is_due():
    reference = StreamReference(positions(pose(0.1), pose(0.5)), LIMITS)
    np.testing.assert_allclose(reference.at(0.02)[0], pose(0.11))
    far, _ = reference.at(10.0)
    np.testing.assert_allclose(far, pose(0.1 + 0.5 * MAX_EXTRAPOLATION_S))


@pytest.mark.invariant(2)
def test_inv2_huge_numbers_lead_no_farther_than_the_range_and_the_fastest_velocity():
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


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        ({'positions': np.full((2, 6), np.nan)}, 'positions = nan is not finite, in point 0'),
        ({'velocities': np.full((2, 6), np.inf)}, 'velocities = inf is not finite, in point 0'),
        ({'positions': np.zeros((2, 5))}, 'positions of shape (2, 5) for 6 joints'),
    ],
)
def test_a_point_before_the_last_one_is_checked_too(change, text):
    points = {'positions': np.zeros((2, 6)), 'velocities': np.zeros((2, 6))} | change
    setpoint = Setpoint('x', HOME, HOME, Window(np.array([0.0, 0.1]), **points))
    assert text in setpoint.problem(LIMITS)


TIMES = np.array([0.1, 0.2])
STILL = np.zeros((2, 6))


def changed(value):
    values = STILL.copy()
    values[0, 2] = value
    return values


@pytest.mark.parametrize(
    ('positions', 'velocities', 'said'),
    [
        (STILL, None, None),
        (STILL, STILL, None),
        (changed(np.nan), None, 'joint_3: positions = nan is not finite, in point 0'),
        (STILL, changed(np.inf), 'joint_3: velocities = inf is not finite, in point 0'),
        (STILL[:, :5], None, 'positions of shape (2, 5) for 6 joints'),
        (STILL, STILL[:1], 'velocities of shape (1, 6) for 6 joints'),
    ],
)
def test_a_window_may_have_velocities_and_all_of_it_is_looked_at(positions, velocities, said):
    window = Window(TIMES, positions, velocities)
    assert Setpoint('~/servo', np.zeros(6), window=window).problem(LIMITS) == said


def test_a_setpoint_of_nothing_is_wrong_but_beyond_no_limit():
    nothing = Setpoint('~/servo')
    assert nothing.problem(LIMITS) == 'it has neither positions nor velocities'
    assert nothing.beyond(LIMITS, LIMITS.velocity) is None


@pytest.mark.parametrize(
    ('setpoint', 'said'),
    [
        (
            Setpoint('~/servo', np.zeros(6), changed(10.0)[0]),
            'joint_3: velocity 10 rad/s is beyond what the joint can do, 8.97 rad/s',
        ),
        (
            Setpoint('~/servo', STILL[0], window=Window(np.array([0.0, 1e-9]), changed(0.05))),
            'joint_3: the way between two points as velocity -5e+07 rad/s is beyond what the '
            'joint can do, 8.97 rad/s',
        ),
        (
            Setpoint('~/servo', STILL[0], window=Window(TIMES, STILL, STILL + 1.0)),
            'joint_1: its velocities lead by 0.1 rad, where its positions move by 0 rad',
        ),
    ],
    ids=['velocity', 'points too near each other', 'contradiction'],
)
@pytest.mark.invariant(2)
def test_inv2_what_no_joint_can_do_is_refused(setpoint, said):
    assert setpoint.problem(LIMITS) == said


def test_velocities_alone_are_clipped_and_not_refused():
    assert Setpoint('~/joint_jog', None, np.full(6, 100.0)).problem(LIMITS) is None
