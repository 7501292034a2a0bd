# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The reference of a goal and its clock, with the speed scaling."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.driver.goal.reference import (
    MIN_FACTOR,
    RAMP_PER_S,
    GoalClock,
    ReferenceTrajectory,
    SpeedScaling,
    scaled,
)
from epson_driver.motion import Trajectory
from epson_driver.simple_message import JointTrajPt, JointTrajPtFull, Ping, ValidFields, joint_data

NAMES = ('a', 'b')
TIMES = np.array([0.0, 0.5, 2.0])


def derivatives(polynomials, order):
    return np.array([[polynomial.deriv(order)(t) for polynomial in polynomials] for t in TIMES])


POLYNOMIALS = [np.poly1d([1.0, -2.0, 3.0, 0.5, -1.0, 0.2]), np.poly1d([-0.5, 0.3, 1.0, 0.0, 0.1])]


def planned(orders, polynomials):
    parts = [derivatives(polynomials, order) for order in range(orders)]
    return Trajectory(NAMES, TIMES, *parts)


@given(st.floats(0.0, 2.0))
def test_accelerations_give_quintic_interpolation(time):
    positions, velocities = ReferenceTrajectory(planned(3, POLYNOMIALS), np.zeros(2)).at(time)
    np.testing.assert_allclose(
        positions, [polynomial(time) for polynomial in POLYNOMIALS], atol=1e-9
    )
    if time < 2.0:
        expected = [polynomial.deriv()(time) for polynomial in POLYNOMIALS]
        np.testing.assert_allclose(velocities, expected, atol=1e-8)


@given(st.floats(0.0, 2.0))
def test_velocities_give_cubic_interpolation(time):
    cubics = [np.poly1d([1.0, -2.0, 0.5, 3.0]), np.poly1d([0.2, 0.0, -1.0])]
    positions, velocities = ReferenceTrajectory(planned(2, cubics), np.zeros(2)).at(time)
    np.testing.assert_allclose(positions, [cubic(time) for cubic in cubics], atol=1e-9)
    if time < 2.0:
        np.testing.assert_allclose(
            velocities, [cubic.deriv()(time) for cubic in cubics], atol=1e-8
        )


def test_positions_without_velocities_give_linear_interpolation():
    line = Trajectory(NAMES, TIMES, np.array([[0.0, 0.0], [1.0, -1.0], [1.0, 2.0]]))
    positions, velocities = ReferenceTrajectory(line, np.zeros(2)).at(0.25)
    assert positions.tolist() == [0.5, -0.5]
    assert velocities.tolist() == [2.0, -2.0]
    positions, velocities = ReferenceTrajectory(line, np.zeros(2)).at(1.25)
    assert positions.tolist() == [1.0, 0.5]
    assert velocities.tolist() == [0.0, 2.0]


def test_first_point_after_0_s_is_approached_from_start():
    line = Trajectory(NAMES, np.array([2.0]), np.array([[1.0, 1.0]]))
    reference = ReferenceTrajectory(line, np.array([0.0, 0.5]))
    assert reference.at(1.0)[0].tolist() == [0.5, 0.75]
    assert reference.at(2.0)[0].tolist() == [1.0, 1.0]
    assert reference.at(99.0)[1].tolist() == [0.0, 0.0]


def test_single_point_at_0_s_is_constant():
    line = Trajectory(NAMES, np.array([0.0]), np.array([[1.0, 1.0]]))
    assert ReferenceTrajectory(line, np.zeros(2)).at(0.0)[0].tolist() == [1.0, 1.0]


# --- the clock --------------------------------------------------------------------------------


def clock(scaling=None):
    line = Trajectory(
        NAMES, np.array([0.0, 1.0, 2.0]), np.array([[0.0] * 2, [1.0] * 2, [2.0] * 2])
    )
    return GoalClock(line, np.zeros(2), scaling or SpeedScaling(), 100.0)


def test_plan_clock_runs_from_the_first_point_past_the_end():
    made = clock()
    made.advance(100.7)
    assert made.time == pytest.approx(0.7)
    made.advance(105.0)
    assert made.time == pytest.approx(5.0)
    assert made.desired()[0].tolist() == [2.0, 2.0]


def test_sent_segments_keep_their_speed_factor_and_unsent_ones_use_the_new_one():
    scaling = SpeedScaling()
    made = clock(scaling)
    made.sent(1.0)
    made.sent(0.5)  # the segment to 1 s takes 2 s
    scaling.set(0.25, 50.0)
    made.advance(101.0)
    assert made.time == pytest.approx(0.5)
    assert made.desired()[1].tolist() == [0.5, 0.5]
    made.advance(104.0)  # a second to its end, two beyond it
    assert made.time == pytest.approx(1.5)
    assert made.rate == 0.25


def test_plan_clock_excludes_the_time_while_it_is_stopped():
    made = clock()
    made.advance(100.5)
    made.advance(103.0, running=False)
    assert made.rate == 0.0
    made.advance(103.25)
    assert made.time == pytest.approx(0.75)


@given(st.lists(st.floats(0.0, 1.0), max_size=20))
def test_plan_clock_does_not_depend_on_the_step_size(steps):
    made, at_once = clock(), clock()
    for item in (made, at_once):
        for factor in (1.0, 0.5, 0.1):
            item.sent(factor)
    now = 100.0
    for step in steps:
        now += step
        made.advance(now)
    at_once.advance(now)
    assert made.time == pytest.approx(at_once.time, abs=1e-9)


def test_plan_clock_waits_for_the_start_of_the_plan():
    made = clock()
    made.advance(99.0)
    assert made.time == 0.0
    assert made.desired()[1].tolist() == [0.0, 0.0]
    made.advance(100.5)
    assert made.time == pytest.approx(0.5)


FACTORS = st.floats(MIN_FACTOR, 1.0)


def test_initial_speed_factor_is_1():
    scaling = SpeedScaling()
    assert scaling.factor(0.0) == scaling.factor(1e9) == scaling.target == 1.0
    assert scaling.time_for(0.3, 5.0) == 0.3


def test_speed_factor_set_during_a_ramp_starts_another_ramp():
    scaling = SpeedScaling()
    scaling.set(0.01, 10.0)
    assert scaling.factor(10.0) == 1.0
    assert scaling.factor(10.0 + 0.25 / RAMP_PER_S) == pytest.approx(0.75)
    assert scaling.factor(10.0 + 1.0 / RAMP_PER_S) == 0.01
    scaling.set(0.5, 10.0 + 0.75 / RAMP_PER_S)
    assert scaling.factor(10.0 + 0.75 / RAMP_PER_S) == pytest.approx(0.25)
    assert scaling.factor(10.0 + 0.9 / RAMP_PER_S) == pytest.approx(0.4)
    assert scaling.factor(11.0) == 0.5


@pytest.mark.parametrize('bad', [-0.1, MIN_FACTOR / 2, 1.001, math.nan, math.inf, -math.inf])
def test_invalid_speed_factor_is_rejected_with_the_allowed_range(bad):
    scaling = SpeedScaling()
    with pytest.raises(ValueError, match=r'must be 0 \(pause\) or from 0.01 to 1'):
        scaling.set(bad, 1.0)
    assert scaling.target == 1.0


@given(FACTORS, FACTORS, st.floats(0.0, 1.0), st.floats(1e-3, 2.0))
def test_time_for_planned_time_integrates_the_speed_factor(first, then, since, planned):
    scaling = SpeedScaling()
    scaling.set(first, 0.0)
    scaling.set(then, 10.0)
    start = 10.0 + since
    takes = scaling.time_for(planned, start)
    steps = 2000
    step = takes / steps
    done = sum(scaling.factor(start + (index + 0.5) * step) for index in range(steps)) * step
    assert done == pytest.approx(planned, rel=1e-3)


def test_pause_takes_effect_immediately_and_ends_in_a_ramp():
    scaling = SpeedScaling()
    scaling.set(0.0, 0.0)
    assert scaling.factor(0.0) == 0.0
    scaling.set(1.0, 5.0)
    assert scaling.time_for(1.0, 5.0) == pytest.approx(1.0 + 0.5 / RAMP_PER_S)


POINT = JointTrajPt(3, joint_data([0.1, 0.2]), 0.6, 0.5)


def test_scaled_point_has_lower_velocity_and_longer_duration():
    slow = scaled(POINT, 0.5, 0.5)
    assert (slow.velocity, slow.duration) == (0.3, 1.0)
    assert (slow.sequence, slow.joints) == (POINT.sequence, POINT.joints)
    assert scaled(POINT, 0.001, 1.0).velocity == 1e-3


def test_minimum_speed_factor_keeps_a_velocity_that_can_be_sent():
    slow = replace(POINT, velocity=0.01)
    assert SpeedScaling().least(slow) == pytest.approx(0.1)
    assert SpeedScaling(by_velocity=False).least(slow) == 0.0
    assert SpeedScaling().least(Ping()) == 0.0


def test_scaled_full_point_has_later_time_and_lower_velocities():
    fields = ValidFields.TIME | ValidFields.POSITION
    full = JointTrajPtFull(0, 3, fields, 2.0, (1.0,) * 10, (4.0,) * 10, (8.0,) * 10)
    slow = scaled(full, 0.5, 0.75)
    assert slow.time == 2.75
    assert slow.positions == full.positions
    assert slow.velocities == (2.0,) * 10
    assert slow.accelerations == (2.0,) * 10
    late = scaled(full, 1.0, 0.75)  # slower ones came before it
    assert (late.time, late.velocities) == (2.75, full.velocities)


def test_point_scaled_by_1_without_delay_is_unchanged():
    assert scaled(POINT, 1.0, 0.0) is POINT
    assert scaled(POINT, 1.0, 0.3) == POINT
    assert scaled(Ping(), 0.5, 1.0) == Ping()
