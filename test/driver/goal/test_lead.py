# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How far ahead a goal is sent that may be left: a stop from its speed and what is measured."""

import numpy as np
import pytest

from epson_driver.driver.goal.lead import (
    MAX_LATENCY_S,
    MAX_SAMPLES,
    MIN_LATENCY_S,
    MIN_SAMPLES,
    Lead,
)
from epson_driver.motion import JointLimits, Trajectory
from epson_driver.motion.joint_motion import fastest_stop

LIMITS = JointLimits(
    ('joint_1', 'joint_2'),
    np.full(2, -3.0),
    np.full(2, 3.0),
    np.array([2.0, 4.0]),
    np.array([20.0, 30.0]),
    np.array([200.0, 400.0]),
)


def seen(*behind, speed=1.0, count=MAX_SAMPLES):
    """Return a lead that saw an arm so far behind, s, one after the other."""
    lead = Lead(LIMITS)
    velocity = speed * LIMITS.velocity * np.array([1.0, -0.5])
    for index in range(count):
        lead.see(behind[index % len(behind)] * velocity, velocity)
    return lead


def test_the_most_is_a_stop_from_full_speed_and_the_latency_that_is_not_measured_yet():
    assert Lead(LIMITS).most == pytest.approx(0.2 + 4.0 / 30.0 + 30.0 / 400.0)
    assert Lead(LIMITS).latency == MAX_LATENCY_S
    assert seen(0.01, count=MIN_SAMPLES - 1).latency == MAX_LATENCY_S


@pytest.mark.parametrize('speed', [0.06, 0.3, 1.0])
def test_the_latency_follows_how_far_the_arm_is_behind(speed):
    assert seen(0.11, speed=speed).latency == pytest.approx(0.143)
    assert seen(0.09, 0.12, speed=speed).latency == pytest.approx(0.156)
    assert seen(0.09, *[0.0] * 15, speed=speed).latency == MIN_LATENCY_S  # one in 16


@pytest.mark.parametrize(
    ('behind', 'latency'),
    [(0.0, MIN_LATENCY_S), (-0.3, MIN_LATENCY_S), (0.16, MAX_LATENCY_S), (5.0, MAX_LATENCY_S)],
)
def test_it_has_bounds_whatever_is_measured(behind, latency):
    assert seen(behind).latency == latency


def test_what_was_measured_long_ago_and_at_a_crawl_does_not_count():
    lead = seen(0.01)
    for behind, speed in ((0.13, 1.0), (0.01, 0.04)):
        velocity = speed * LIMITS.velocity
        for _ in range(MAX_SAMPLES):
            lead.see(behind * velocity, velocity)
    assert lead.latency == pytest.approx(1.3 * 0.13)


def test_a_stop_is_from_the_highest_speed_on_the_way_to_a_point():
    """Against Ruckig's: from each joint's speed, at its ends and in the mean."""
    speeds = np.array([[0.0, 0.0], [0.5, 0.1], [1.9, -3.9], [0.0, 0.0]])
    positions = np.array([[0.0, 0.0], [0.02, 0.0], [0.1, -0.1], [0.2, -0.2]])
    way = Trajectory(LIMITS.names, np.array([0.0, 0.1, 0.2, 0.3]), positions, speeds)

    def needed(*velocity):
        velocity = np.array(velocity)
        return fastest_stop(LIMITS, (np.zeros(2), velocity, np.zeros(2))).duration

    expected = [needed(0.5, 0.1), needed(1.9, 3.9), needed(1.9, 3.9)]
    np.testing.assert_allclose(Lead(LIMITS).stops(way), expected, rtol=1e-6)
    fast = Trajectory(LIMITS.names, np.array([0.0, 0.1]), positions[[0, 3]], np.zeros((2, 2)))
    np.testing.assert_allclose(Lead(LIMITS).stops(fast), [needed(2.0, 2.0)], rtol=1e-6)
