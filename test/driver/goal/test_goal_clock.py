# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Where a goal should be at a moment: the plan as a function of time, and the clock."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.driver.goal.goal_clock import GoalClock, Reference
from epson_driver.driver.goal.speed_scaling import SpeedScaling
from epson_driver.motion import Trajectory

NAMES = ('a', 'b')
TIMES = np.array([0.0, 0.5, 2.0])


def derivatives(polynomials, order):
    return np.array([[each.deriv(order)(t) for each in polynomials] for t in TIMES])


POLYNOMIALS = [np.poly1d([1.0, -2.0, 3.0, 0.5, -1.0, 0.2]), np.poly1d([-0.5, 0.3, 1.0, 0.0, 0.1])]


def planned(orders, polynomials):
    parts = [derivatives(polynomials, order) for order in range(orders)]
    return Trajectory(NAMES, TIMES, *parts)


@given(st.floats(0.0, 2.0))
def test_accelerations_make_a_quintic(time):
    positions, velocities = Reference(planned(3, POLYNOMIALS), np.zeros(2)).at(time)
    np.testing.assert_allclose(positions, [each(time) for each in POLYNOMIALS], atol=1e-9)
    if time < 2.0:
        expected = [each.deriv()(time) for each in POLYNOMIALS]
        np.testing.assert_allclose(velocities, expected, atol=1e-8)


@given(st.floats(0.0, 2.0))
def test_velocities_make_a_cubic(time):
    cubics = [np.poly1d([1.0, -2.0, 0.5, 3.0]), np.poly1d([0.2, 0.0, -1.0])]
    positions, velocities = Reference(planned(2, cubics), np.zeros(2)).at(time)
    np.testing.assert_allclose(positions, [each(time) for each in cubics], atol=1e-9)
    if time < 2.0:
        np.testing.assert_allclose(velocities, [each.deriv()(time) for each in cubics], atol=1e-8)


def test_positions_alone_are_joined_by_lines():
    line = Trajectory(NAMES, TIMES, np.array([[0.0, 0.0], [1.0, -1.0], [1.0, 2.0]]))
    positions, velocities = Reference(line, np.zeros(2)).at(0.25)
    assert positions.tolist() == [0.5, -0.5]
    assert velocities.tolist() == [2.0, -2.0]
    positions, velocities = Reference(line, np.zeros(2)).at(1.25)
    assert positions.tolist() == [1.0, 0.5]
    assert velocities.tolist() == [0.0, 2.0]


def test_a_first_point_later_than_0_is_gone_to_from_where_the_arm_stands():
    line = Trajectory(NAMES, np.array([2.0]), np.array([[1.0, 1.0]]))
    reference = Reference(line, np.array([0.0, 0.5]))
    assert reference.at(1.0)[0].tolist() == [0.5, 0.75]
    assert reference.at(2.0)[0].tolist() == [1.0, 1.0]
    assert reference.at(99.0)[1].tolist() == [0.0, 0.0]


def test_a_single_point_at_0():
    line = Trajectory(NAMES, np.array([0.0]), np.array([[1.0, 1.0]]))
    assert Reference(line, np.zeros(2)).at(0.0)[0].tolist() == [1.0, 1.0]


# --- the clock --------------------------------------------------------------------------------


def clock(scaling=None):
    line = Trajectory(
        NAMES, np.array([0.0, 1.0, 2.0]), np.array([[0.0] * 2, [1.0] * 2, [2.0] * 2])
    )
    return GoalClock(line, np.zeros(2), scaling or SpeedScaling(), 100.0)


def test_it_runs_from_the_first_point_on_and_past_the_end():
    made = clock()
    made.advance(100.7)
    assert made.time == pytest.approx(0.7)
    made.advance(105.0)
    assert made.time == pytest.approx(5.0)
    assert made.desired()[0].tolist() == [2.0, 2.0]


def test_what_was_sent_keeps_its_factor_and_the_rest_has_that_of_the_moment():
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


def test_it_stands_where_points_are_held_back():
    made = clock()
    made.sent(1.0)
    made.sent(1.0)
    made.held = True
    made.advance(110.0)
    assert made.time == pytest.approx(1.0)
    assert made.desired()[1].tolist() == [0.0, 0.0]


def test_it_stands_while_it_does_not_run_and_forgets_that_time():
    made = clock()
    made.advance(100.5)
    made.advance(103.0, running=False)
    assert made.rate == 0.0
    made.advance(103.25)
    assert made.time == pytest.approx(0.75)


@given(st.lists(st.floats(0.0, 1.0), max_size=20))
def test_the_steps_do_not_matter(steps):
    made, at_once = clock(), clock()
    for each in (made, at_once):
        for factor in (1.0, 0.5, 0.1):
            each.sent(factor)
    now = 100.0
    for step in steps:
        now += step
        made.advance(now)
    at_once.advance(now)
    assert made.time == pytest.approx(at_once.time, abs=1e-9)


def test_it_stands_until_the_plan_begins():
    made = clock()
    made.advance(99.0)
    assert made.time == 0.0
    assert made.desired()[1].tolist() == [0.0, 0.0]
    made.advance(100.5)
    assert made.time == pytest.approx(0.5)
