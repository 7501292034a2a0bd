# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The streaming arm: power, the fields of a point, acknowledgement, settling."""

import dataclasses

import numpy as np
import pytest
from support.examples import one_in
from support.streaming_harness import (
    HOME,
    LIMITS,
    StreamingHarness,
    assert_passes,
    assert_within_limits,
    curve_points,
)

from epson_driver.motion.smoother import plan
from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.sim_controller.arm.low_power import LowPower
from epson_driver.sim_controller.arm.streaming import MAX_ATTEMPTS

REACH = np.array([0.8, 0.7, 0.5, 0.35, 0.33, 0.1])
FRACTION, TOOL_SPEED = 0.05, 0.25
LOW = LowPower(FRACTION, TOOL_SPEED, REACH).limits(LIMITS)
FAST = curve_points(40, 0.8)


def fastest(velocities):
    """Return the largest fraction of the velocity limits, and the largest tool speed, m/s."""
    speeds = np.abs(velocities)
    return float(np.max(speeds / LIMITS.velocity)), float(np.max(speeds @ REACH))


# ---- low power


def low_harness(low=True, **values):
    harness = StreamingHarness(low_power_limits=LOW, **values)
    harness.arm.low_power = low
    return harness


@pytest.mark.invariant(2)
@pytest.mark.parametrize('period', one_in(2, [0.0, 0.02]))
def test_inv2_low_power_caps_every_joint_and_the_tool(period):
    harness = low_harness()
    points = curve_points(25, 0.2)
    harness.send(points, period)
    harness.rest()
    fraction, tool = fastest(harness.velocities)
    assert fraction <= FRACTION
    assert tool <= TOOL_SPEED
    assert tool > 0.5 * TOOL_SPEED
    assert_within_limits(harness, LOW)
    assert_passes(harness, points)
    assert all(limits is LOW for limits in harness.planner.limits)


@pytest.mark.parametrize('low', one_in(2, [False, True]))
def test_power_changed_in_motion_applies_after_the_next_rest(low):
    harness = low_harness(not low)
    points = curve_points(15, 0.1)
    harness.send(points)
    harness.run(0.2)
    assert harness.arm.velocity.any()
    harness.arm.low_power = low
    harness.rest()
    before = len(harness.positions)
    assert_within_limits(harness, LIMITS if low else LOW)
    assert (fastest(harness.velocities)[0] > FRACTION) is low
    harness.send(points[::-1])
    harness.rest()
    assert_within_limits(harness, LOW if low else LIMITS, before)
    assert (fastest(harness.velocities[before:])[0] > FRACTION) is not low


def test_stop_at_low_power_respects_the_caps():
    harness = low_harness()
    harness.send(curve_points(15, 0.1))
    harness.run(0.5)
    assert harness.arm.velocity.any()
    harness.arm.low_power = False
    harness.waiting.clear()
    harness.arm.stop()
    harness.until_still()
    assert_within_limits(harness, LOW)


@pytest.mark.parametrize('low', [False, True])
def test_power_changed_in_a_hold_applies_after_resume(low):
    harness = low_harness(not low)
    points = curve_points(15, 0.1)
    harness.send(points)
    harness.run(0.2 if low else 1.0)
    harness.arm.hold()
    harness.until_still()
    before = len(harness.positions)
    assert_within_limits(harness, LIMITS if low else LOW)
    harness.arm.low_power = low
    harness.run(0.2)
    harness.arm.resume()
    harness.rest()
    assert_within_limits(harness, LOW if low else LIMITS, before)
    assert (fastest(harness.velocities[before:])[0] > FRACTION) is not low
    assert_passes(harness, points)


def test_power_changed_during_the_first_planning_applies():
    harness = low_harness(False, delay=0.06)
    points = curve_points(15, 0.1)
    harness.send(points)
    harness.run(0.07)
    assert not harness.arm.velocity.any()
    harness.arm.low_power = True
    harness.rest()
    assert_within_limits(harness, LOW)
    assert_passes(harness, points)
    assert harness.timing.late_plans == 0


# ---- when a point is answered


# ---- the fields of a point


@pytest.mark.parametrize(
    ('uses', 'velocity', 'duration', 'least', 'most'),
    [
        ('both', 0.1, 2.0, 2.0, 2.4),
        ('both', 0.1, 0.0, 1.27, 1.6),  # 1 rad at a tenth of 7.85 rad/s
        ('both', 0.0, 0.0, 0.2, 0.7),  # as fast as the limits allow
        ('duration', 0.1, 2.0, 2.0, 2.4),
        ('duration', 0.1, 0.0, 0.2, 0.7),
        ('velocity', 0.1, 2.0, 1.27, 1.6),
        ('velocity', 0.0, 2.0, 0.2, 0.7),
        ('nothing', 0.1, 2.0, 0.63, 1.0),  # `speed`: a fifth
        ('nothing', 0.0, 0.0, 0.63, 1.0),
    ],
)
def test_profile_selects_the_fields_that_apply(uses, velocity, duration, least, most):
    harness = StreamingHarness(uses=FieldsUsed(uses), speed=0.2)
    harness.send([HOME])
    harness.send([np.eye(6)[0]], duration, velocity, first=1)
    assert least <= harness.rest() <= most


def test_speed_changes_the_next_motion():
    harness = StreamingHarness(uses=FieldsUsed.NOTHING)
    times = []
    for index, speed in enumerate((1.0, 0.1)):
        harness.arm.speed = speed
        harness.send([HOME if index else np.eye(6)[0]], first=1)
        times.append(harness.rest())
    assert times[0] < 0.7
    assert 1.27 < times[1] < 1.6


def test_start_outside_the_limits_is_refused():
    with pytest.raises(ValueError, match='the start, joint_1: position 9 is outside the limits'):
        StreamingHarness(start=np.full(6, 9.0))


# ---- settling


ELSEWHERE = np.array([0.3, -0.2, 0.1, 0.0, 0.5, -1.0])


def test_arm_moved_by_hand_starts_from_its_new_position():
    harness = StreamingHarness()
    harness.send(FAST)
    harness.run(0.3)
    harness.waiting.clear()
    harness.arm.stop()
    harness.until_still()
    harness.arm.set_position(ELSEWHERE)
    assert harness.arm.position.tolist() == ELSEWHERE.tolist()
    assert not harness.arm.velocity.any()
    assert harness.arm.at_rest
    harness.run(0.5)  # a pending plan is discarded
    assert harness.arm.position.tolist() == ELSEWHERE.tolist()
    since = len(harness.positions)
    harness.send([ELSEWHERE, HOME], 0.5)
    assert 0.5 < harness.rest() < 0.8
    assert_within_limits(harness, since=since)
    assert harness.arm.position.tolist() == HOME.tolist()


def test_setting_the_position_is_refused_while_points_remain():
    harness = StreamingHarness()
    harness.send(FAST)
    with pytest.raises(RuntimeError, match='has pending points'):
        harness.arm.set_position(ELSEWHERE)
    harness.run(0.4)
    harness.arm.hold()
    harness.until_still()
    with pytest.raises(RuntimeError, match='has pending points'):
        harness.arm.set_position(ELSEWHERE)
    harness.arm.resume()
    harness.rest()
    assert_passes(harness, FAST)


# ---- the planner


@pytest.mark.invariant(1)
def test_inv1_plan_requested_before_a_stop_is_discarded():
    harness = StreamingHarness(delay=0.2)
    harness.send(FAST)
    harness.run(0.1)
    harness.waiting.clear()
    harness.arm.stop()
    since = len(harness.positions)
    harness.arm.set_position(ELSEWHERE)
    harness.send([ELSEWHERE, HOME], 0.5)
    harness.rest()
    assert_within_limits(harness, since=since)
    assert harness.arm.position.tolist() == HOME.tolist()
    assert harness.timing.late_plans == 0


def test_planner_without_a_solution_fails_after_several_attempts():
    harness = StreamingHarness()
    harness.planner.plan = lambda request, limits: None
    harness.send(FAST)
    while not harness.failures:
        harness.run(0.001)
    assert len(harness.planner.limits) == MAX_ATTEMPTS
    assert harness.arm.position.tolist() == HOME.tolist()


@pytest.mark.invariant(2, 9)
def test_inv2_plan_beyond_a_limit_brakes_and_is_reported():
    """The arm checks each plan against the limits."""
    harness = StreamingHarness()
    faster = dataclasses.replace(
        LIMITS,
        velocity=5.0 * LIMITS.velocity,
        acceleration=5.0 * LIMITS.acceleration,
        jerk=5.0 * LIMITS.jerk,
    )
    harness.planner.plan = lambda request, limits: plan(request, faster)
    harness.send(FAST, period=0.0)
    harness.waiting.clear()
    while not harness.failures:
        harness.run(0.001)
    assert harness.timing.violations == 1
    (failure,) = harness.failures
    assert failure.startswith('the arm brakes: joint_')
    assert 'is beyond the limit' in failure
    assert harness.arm.at_rest or not harness.arm.has_room  # a braking arm accepts no point
    harness.rest()
    assert_within_limits(harness)
    # the next motion starts from the current position
    harness.planner.plan = plan
    harness.send(harness.arm.position + curve_points(40), first=0)
    harness.rest()
    assert harness.timing.violations == 1
    assert_within_limits(harness)


def test_setting_the_position_does_not_end_a_hold():
    harness = StreamingHarness()
    harness.arm.hold()
    harness.arm.set_position(ELSEWHERE)
    harness.send([HOME], 0.5, first=1)
    assert harness.taken == 0
    harness.arm.resume()
    harness.rest()
    assert harness.arm.position.tolist() == HOME.tolist()
