# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The rest of a plan after a pause."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.driver_harness import HOME, LIMITS, pose

from epson_driver.driver.delivery.streaming import MIN_VELOCITY
from epson_driver.driver.goal.goal import check_limits
from epson_driver.driver.goal.reference import FROM_REST, remainder
from epson_driver.motion import Trajectory


def plan(*places, step=1.0, first=0.0):
    times = first + step * np.arange(len(places))
    return Trajectory(LIMITS.names, times, np.array([pose(place) for place in places]))


def rest_of(trajectory, at, expected):
    return remainder(trajectory, HOME, pose(at), expected, LIMITS)


def places(trajectory):
    return trajectory.positions[:, 0].tolist()


def test_remainder_omits_passed_points_and_keeps_the_times_of_others():
    rest = rest_of(plan(0.0, 0.4, 0.8, 1.2), 0.6, 1.5)
    assert places(rest) == [0.6, 0.8, 1.2]
    assert rest.times.tolist() == pytest.approx([0.0, FROM_REST * 0.5, FROM_REST * 0.5 + 1.0])


def test_remainder_of_a_one_point_plan_starts_at_the_arm():
    assert places(rest_of(plan(1.0, first=2.0), 0.25, 0.5)) == [0.25, 1.0]


def test_point_at_rest_position_is_omitted_unless_last():
    assert places(rest_of(plan(0.0, 0.4, 0.8), 0.4, 1.0)) == [0.4, 0.8]
    assert places(rest_of(plan(0.0, 0.4, 0.8), 0.8, 2.0)) == [0.8, 0.8]


@pytest.mark.parametrize(
    ('expected', 'left'),
    [(0.5, [0.5, 1.0, 0.0, 1.0, 0.0]), (1.5, [0.5, 0.0, 1.0, 0.0]), (3.4, [0.5, 0.0])],
)
def test_position_passed_repeatedly_is_matched_by_expected_time(expected, left):
    assert places(rest_of(plan(0.0, 1.0, 0.0, 1.0, 0.0), 0.5, expected)) == left


def test_remainder_has_velocities_that_start_from_rest():
    made = plan(0.0, 0.4, 0.8)
    rate = np.zeros_like(made.positions)
    rate[1, 0] = 0.4
    made = Trajectory(made.joint_names, made.times, made.positions, rate, rate)
    rest = rest_of(made, 0.1, 0.25)
    assert rest.velocities[:, 0].tolist() == [0.0, 0.4, 0.0]
    assert rest.accelerations[:, 0].tolist() == [0.0, 0.4, 0.0]


@pytest.mark.parametrize('noise', [0.0, 1e-203, 1e-6])
def test_remainder_of_a_plan_without_motion_is_the_whole_plan(noise):
    made = plan(0.0, noise)
    assert rest_of(made, 0.01, 0.5) is made


def test_tiny_plan_has_short_remainder():
    """The plan moves by 0.2 mrad, and the arm is 30 mrad from it."""
    assert rest_of(plan(0.0, 2e-4), 0.03, 0.0).duration < 10.0


@pytest.mark.invariant(2)
@given(
    st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=8),
    st.floats(0.0, 1.0),
    st.floats(-0.05, 0.05),
    st.floats(0.05, 3.0),
)
def test_inv2_remainder_is_no_faster_than_the_plan(points, share, aside, step):
    """The arm is at rest on the path or next to it."""
    made = plan(0.0, *points, step=step)
    time = share * made.duration
    at = float(np.interp(time, made.times, made.positions[:, 0]))
    rest = remainder(made, HOME, pose(at, aside), time, LIMITS)
    speeds = np.abs(np.diff(rest.positions, axis=0)) / np.diff(rest.times)[:, None]
    planned = np.abs(np.diff(made.positions, axis=0)) / np.diff(made.times)[:, None]
    fastest = (planned / LIMITS.velocity).max()
    assert (speeds / LIMITS.velocity).max() <= max(fastest, MIN_VELOCITY) * (1 + 1e-9)
    np.testing.assert_array_equal(rest.positions[-1], made.positions[-1])
    if fastest < 1.0:
        check_limits(rest, LIMITS)
