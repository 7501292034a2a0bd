# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The smoothly moving arm alone: power, what counts of a point, when it is answered, settling."""

import dataclasses

import numpy as np
import pytest
from streaming_bench import (
    HOME,
    LIMITS,
    StreamingBench,
    assert_passes,
    assert_within_limits,
    way,
)

from epson_driver.controller.arm.low_power import LowPower
from epson_driver.controller.arm.streaming import ATTEMPTS
from epson_driver.motion.smoother import plan

REACH = np.array([0.8, 0.7, 0.5, 0.35, 0.33, 0.1])
FRACTION, TOOL_SPEED = 0.05, 0.25
LOW = LowPower(FRACTION, TOOL_SPEED, REACH).limits(LIMITS)
FAST = way(40, 0.8)


def fastest(velocities):
    """Return the largest velocity, as a share of the limits, and the tool's bound, m/s."""
    speeds = np.abs(velocities)
    return float(np.max(speeds / LIMITS.velocity)), float(np.max(speeds @ REACH))


# ---- low power


def low_bench(low=True, **values):
    bench = StreamingBench(low_power_limits=LOW, **values)
    bench.arm.low_power = low
    return bench


@pytest.mark.parametrize('period', [0.0, 0.02])
def test_low_power_caps_every_joint_and_the_tool(period):
    bench = low_bench()
    points = way(25, 0.2)
    bench.send(points, period)
    bench.rest()
    share, tool = fastest(bench.velocities)
    assert share <= FRACTION
    assert tool <= TOOL_SPEED
    assert tool > 0.5 * TOOL_SPEED
    assert_within_limits(bench, LOW)
    assert_passes(bench, points)
    assert all(limits is LOW for limits in bench.planner.limits)


def test_power_changes_from_one_trajectory_to_the_next():
    bench = low_bench()
    points = way(15, 0.1)
    shares = []
    for low, way_there in ((True, points), (False, points[::-1]), (True, points)):
        bench.arm.low_power = low
        since = len(bench.positions)
        bench.send(way_there)
        bench.rest()
        assert_within_limits(bench, LOW if low else LIMITS, since)
        assert_passes(bench, way_there)
        shares.append(fastest(bench.velocities[since:])[0])
    assert shares[0] == pytest.approx(shares[2], rel=0.01)
    assert shares[1] > 2.0 * FRACTION
    assert not bench.failures


@pytest.mark.parametrize('low', [False, True])
def test_a_change_of_power_in_motion_counts_from_the_next_rest_on(low):
    bench = low_bench(not low)
    points = way(15, 0.1)
    bench.send(points)
    bench.run(0.2)
    assert bench.arm.velocity.any()
    bench.arm.low_power = low
    bench.rest()
    before = len(bench.positions)
    assert_within_limits(bench, LIMITS if low else LOW)
    assert (fastest(bench.velocities)[0] > FRACTION) is low
    bench.send(points[::-1])
    bench.rest()
    assert_within_limits(bench, LOW if low else LIMITS, before)
    assert (fastest(bench.velocities[before:])[0] > FRACTION) is not low


def test_a_stop_at_low_power_keeps_to_its_caps():
    bench = low_bench()
    bench.send(way(15, 0.1))
    bench.run(0.5)
    assert bench.arm.velocity.any()
    bench.arm.low_power = False
    bench.waiting.clear()
    bench.arm.stop()
    bench.until_still()
    assert_within_limits(bench, LOW)


@pytest.mark.parametrize('low', [False, True])
def test_power_that_changes_in_a_hold_counts_when_the_arm_goes_on(low):
    bench = low_bench(not low)
    points = way(15, 0.1)
    bench.send(points)
    bench.run(0.2 if low else 1.0)
    bench.arm.hold()
    bench.until_still()
    before = len(bench.positions)
    assert_within_limits(bench, LIMITS if low else LOW)
    bench.arm.low_power = low
    bench.run(0.2)
    bench.arm.resume()
    bench.rest()
    assert_within_limits(bench, LOW if low else LIMITS, before)
    assert (fastest(bench.velocities[before:])[0] > FRACTION) is not low
    assert_passes(bench, points)


def test_power_that_changes_while_the_first_plan_is_made():
    bench = low_bench(False, delay=0.05)
    points = way(15, 0.1)
    bench.send(points)
    bench.run(0.07)
    assert not bench.arm.velocity.any()
    bench.arm.low_power = True
    bench.rest()
    assert_within_limits(bench, LOW)
    assert_passes(bench, points)
    assert bench.timing.late_plans == 0


def test_without_low_power_limits_low_power_is_no_less():
    times = []
    for low in (False, True):
        bench = StreamingBench()
        bench.arm.low_power = low
        bench.send(FAST)
        times.append(bench.rest())
    assert times[0] == times[1]


# ---- when a point is answered


def test_done_means_at_rest_at_each_point():
    bench = StreamingBench(acknowledge='done')
    points = way(8, 0.5)
    bench.send(points, 0.2)
    visited = []
    while bench.arm.moving or bench.waiting:
        assert bench.arm.done is not bench.arm.moving
        assert bench.arm.has_room is not bench.arm.moving
        bench.run(0.001)
        if not bench.arm.velocity.any():
            visited.append(bench.arm.position.tolist())
    for point in points:
        assert point.tolist() in visited
    assert bench.arm.done
    assert_within_limits(bench)
    assert len(bench.positions) * 0.001 < 7 * (0.2 + 0.2)  # none waits for another one


def test_done_at_once_where_the_arm_stands():
    bench = StreamingBench(acknowledge='done')
    bench.send([HOME])
    assert bench.arm.done
    assert not bench.arm.moving


def test_a_point_that_is_not_answered_yet_is_not_lost_by_a_stop():
    bench = StreamingBench(acknowledge='done')
    bench.send([HOME, FAST[-1]], 1.0)
    bench.run(0.5)
    assert bench.arm.moving
    assert not bench.arm.stop()
    bench.until_still()
    assert_within_limits(bench)


def test_a_hold_on_the_way_to_a_point_that_is_done_when_the_arm_is_there():
    bench = StreamingBench(acknowledge='done')
    bench.send([HOME, FAST[-1]], 1.0)
    bench.run(0.5)
    bench.arm.hold()
    bench.until_still()
    assert not bench.arm.done
    bench.arm.resume()
    bench.rest()
    assert bench.arm.done
    assert bench.arm.position.tolist() == FAST[-1].tolist()


def test_taken_points_are_done():
    bench = StreamingBench()
    bench.send(FAST)
    assert bench.arm.done
    assert bench.arm.moving


# ---- what counts of a point


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
def test_the_fields_that_count(uses, velocity, duration, least, most):
    bench = StreamingBench(uses=uses, speed=0.2)
    bench.send([HOME])
    bench.send([np.eye(6)[0]], duration, velocity, first=1)
    assert least <= bench.rest() <= most


def test_speed_can_be_changed():
    bench = StreamingBench(uses='nothing')
    times = []
    for index, speed in enumerate((1.0, 0.1)):
        bench.arm.speed = speed
        bench.send([HOME if index else np.eye(6)[0]], first=1)
        times.append(bench.rest())
    assert times[0] < 0.7
    assert 1.27 < times[1] < 1.6


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        ({'uses': 'all'}, "uses = 'all': must be one of"),
        ({'acknowledge': 'default'}, "acknowledge = 'default': must be one of"),
        ({'start': np.full(6, 9.0)}, 'the start, joint_1: position 9 is outside the limits'),
    ],
)
def test_what_it_cannot_work_with_is_refused(values, sentence):
    with pytest.raises(ValueError, match=sentence):
        StreamingBench(**values)


# ---- settling


ELSEWHERE = np.array([0.3, -0.2, 0.1, 0.0, 0.5, -1.0])


def test_an_arm_that_was_moved_goes_on_from_there():
    bench = StreamingBench()
    bench.send(FAST)
    bench.run(0.3)
    bench.waiting.clear()
    bench.arm.stop()
    bench.until_still()
    bench.arm.settle(ELSEWHERE)
    assert bench.arm.position.tolist() == ELSEWHERE.tolist()
    assert not bench.arm.velocity.any()
    assert bench.arm.still
    bench.run(0.5)  # a plan that was on its way does not count
    assert bench.arm.position.tolist() == ELSEWHERE.tolist()
    since = len(bench.positions)
    bench.send([ELSEWHERE, HOME], 0.5)
    assert 0.5 < bench.rest() < 0.8
    assert_within_limits(bench, since=since)
    assert bench.arm.position.tolist() == HOME.tolist()


def test_only_an_arm_without_points_can_be_moved():
    bench = StreamingBench()
    bench.send(FAST)
    with pytest.raises(RuntimeError, match='has points to go to'):
        bench.arm.settle(ELSEWHERE)
    bench.run(0.4)
    bench.arm.hold()
    bench.until_still()
    with pytest.raises(RuntimeError, match='has points to go to'):
        bench.arm.settle(ELSEWHERE)
    bench.arm.resume()
    bench.rest()
    assert_passes(bench, FAST)


def test_an_arm_that_was_moved_out_of_its_limits_stays_where_it_was():
    bench = StreamingBench()
    with pytest.raises(ValueError, match='joint_2: position 2 is outside the limits'):
        bench.arm.settle(np.full(6, 2.0) * np.eye(6)[1])
    assert bench.arm.position.tolist() == HOME.tolist()
    bench.send(FAST)
    bench.rest()
    assert_passes(bench, FAST)


def test_settling_does_not_end_a_hold():
    bench = StreamingBench()
    bench.arm.hold()
    bench.arm.settle(ELSEWHERE)
    bench.send([HOME], 0.5, first=1)
    assert bench.taken == 0
    bench.arm.resume()
    bench.rest()
    assert bench.arm.position.tolist() == HOME.tolist()


# ---- the planner


def test_plans_on_their_way_when_the_arm_is_stopped_and_moved_do_not_count():
    bench = StreamingBench(delay=0.2)
    bench.send(FAST)
    bench.run(0.1)
    bench.waiting.clear()
    bench.arm.stop()
    since = len(bench.positions)
    bench.arm.settle(ELSEWHERE)
    bench.send([ELSEWHERE, HOME], 0.5)
    bench.rest()
    assert_within_limits(bench, since=since)
    assert bench.arm.position.tolist() == HOME.tolist()
    assert bench.timing.late_plans == 0


def test_a_planner_that_finds_nothing_is_a_failure_after_some_attempts():
    bench = StreamingBench()
    bench.planner.plan = lambda request, limits: None
    bench.send(FAST)
    while not bench.failures:
        bench.run(0.001)
    assert len(bench.planner.limits) == ATTEMPTS
    assert bench.arm.position.tolist() == HOME.tolist()


@pytest.mark.invariant(2, 9)
def test_a_plan_that_would_break_a_limit_is_braked_told_and_counted():
    """Invariants 2 and 9: the arm trusts no planner."""
    bench = StreamingBench()
    faster = dataclasses.replace(
        LIMITS,
        velocity=5.0 * LIMITS.velocity,
        acceleration=5.0 * LIMITS.acceleration,
        jerk=5.0 * LIMITS.jerk,
    )
    bench.planner.plan = lambda request, limits: plan(request, faster)
    bench.send(FAST, period=0.0)
    bench.waiting.clear()
    while not bench.failures:
        bench.run(0.001)
    assert bench.timing.violations == 1
    (failure,) = bench.failures
    assert failure.startswith('the arm brakes: joint_')
    assert 'is beyond the limit' in failure
    assert bench.arm.still or not bench.arm.has_room  # no point is taken by an arm that brakes
    bench.rest()
    assert_within_limits(bench)
    # and it goes on from where it stands
    bench.planner.plan = plan
    bench.send(bench.arm.position + way(40), first=0)
    bench.rest()
    assert bench.timing.violations == 1
    assert_within_limits(bench)
