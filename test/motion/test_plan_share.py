# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The fractions of the joint limits that a plan's times require."""

import numpy as np
import pytest

from epson_driver.motion import Trajectory
from epson_driver.motion.plan_share import MIN_SHARE, plan_share
from epson_driver.robots import load_robot_model

LIMITS = load_robot_model('c3_a601s').limits
HOME = np.zeros(len(LIMITS.names))


def plan(period, velocity, acceleration, joint=0, given=False):
    """Return a trapezoidal plan of one joint at fractions of its limits, `period` s apart."""
    top = velocity * LIMITS.velocity[joint]
    rate = acceleration * LIMITS.acceleration[joint]
    ramp, cruise = top / rate, 0.5
    times = np.append(np.arange(0.0, 2 * ramp + cruise, period), 2 * ramp + cruise)
    up, down = np.minimum(times, ramp), np.maximum(times - ramp - cruise, 0.0)
    positions = np.outer(
        rate * up**2 / 2 + top * np.maximum(times - ramp, 0.0) - rate * down**2 / 2,
        np.arange(len(HOME)) == joint,
    )
    accelerations = np.zeros_like(positions)
    accelerations[:, joint] = rate * ((times < ramp) * 1.0 - (times >= ramp + cruise))
    return Trajectory(LIMITS.names, times, positions, None, accelerations if given else None)


@pytest.mark.invariant(10)
@pytest.mark.parametrize('joint', [0, 4])
@pytest.mark.parametrize(('velocity', 'acceleration'), [(0.1, 0.1), (0.5, 1.0), (1.0, 0.3)])
def test_inv10_fastest_joint_determines_the_share(velocity, acceleration, joint):
    share = plan_share(plan(0.01, velocity, acceleration, joint), HOME, LIMITS)
    assert share == pytest.approx((velocity, acceleration), rel=0.02)
    assert np.all(np.array(share) <= np.array((velocity, acceleration)) + 1e-9)


def test_planned_accelerations_count_where_points_are_sparse():
    sparse = 0.1  # the ramp takes 0.02 s
    assert plan_share(plan(sparse, 0.1, 0.5), HOME, LIMITS)[1] < 0.4
    assert plan_share(plan(sparse, 0.1, 0.5, given=True), HOME, LIMITS)[1] == pytest.approx(0.5)


@pytest.mark.invariant(10)
def test_inv10_share_includes_the_move_to_a_first_point_with_a_time():
    target = Trajectory(LIMITS.names, np.array([2.0]), HOME[None, :] + 0.5)
    velocity, acceleration = plan_share(target, HOME, LIMITS)
    assert velocity == pytest.approx(1.5 * 0.25 / LIMITS.velocity.min())
    assert acceleration == pytest.approx(3.0 * 0.25 / LIMITS.acceleration.min())


@pytest.mark.invariant(10)
def test_inv10_repeated_time_does_not_raise_the_speed_limit():
    slow = plan(0.01, 0.1, 0.1)
    times = slow.times.copy()
    times[7] = times[6]
    share = plan_share(Trajectory(LIMITS.names, times, slow.positions), HOME, LIMITS)
    assert share == pytest.approx((0.1, 0.1), rel=0.02)


def test_share_is_1_if_a_plan_has_no_times_or_exceeds_the_limits():
    slow = plan(0.01, 0.1, 0.1)
    zeros = Trajectory(LIMITS.names, np.zeros(len(slow.times)), slow.positions)
    fast = Trajectory(LIMITS.names, slow.times / 100.0, slow.positions)
    for whole in (zeros, fast):
        assert plan_share(whole, HOME, LIMITS) == (1.0, 1.0)


def test_share_of_a_plan_that_hardly_moves_is_the_minimum():
    still = Trajectory(LIMITS.names, np.array([0.0, 1.0]), np.stack([HOME, HOME]))
    assert plan_share(still, HOME, LIMITS) == (MIN_SHARE, MIN_SHARE)
