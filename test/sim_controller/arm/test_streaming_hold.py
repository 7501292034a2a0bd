# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Holds of smooth motion: on the path, within all limits, without losing points."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.examples import examples, one_in
from support.streaming_harness import (
    DT,
    HOME,
    LIMITS,
    StreamingHarness,
    assert_passes,
    assert_within_limits,
    curve_points,
)

FAST = curve_points(60, 1.0)
"""Points for which PERIOD is too short: the arm is as fast as its limits allow."""


def free_run(points, **values):
    harness = StreamingHarness()
    harness.send(points, **values)
    return harness, harness.rest()


def held_harness(seconds, points=FAST, **values):
    """Return a harness whose arm is at rest after a hold in motion."""
    harness = StreamingHarness(**values)
    harness.send(points)
    harness.run(seconds)
    assert harness.velocities[-1].any()
    harness.arm.hold()
    harness.until_still()
    return harness


def farthest(trace, others):
    """Return the largest distance of a trace from another one, rad."""
    return max(np.min(np.max(np.abs(others - item), axis=1)) for item in trace)


@pytest.mark.invariant(2, 3)
@pytest.mark.parametrize('delay', one_in(2, [0.0, 0.012, 0.1]))
@pytest.mark.parametrize('share', one_in(3, [0.2, 0.3, 0.4, 0.65, 0.9]))
def test_inv2_and_3_hold_brakes_on_the_path_and_keeps_all_points(share, delay):
    free, time = free_run(FAST)
    harness = StreamingHarness(delay)
    harness.send(FAST)
    harness.run(share * time)
    assert np.max(np.abs(harness.arm.velocity) / LIMITS.velocity) > 0.05
    since = len(harness.positions)
    harness.arm.hold()
    assert not harness.arm.at_rest
    assert harness.until_still() < 0.25  # independent of the planner's latency
    assert harness.arm.moving
    assert not harness.arm.velocity.any()
    rest = harness.arm.position.tolist()
    assert farthest(harness.trace[since::10], free.trace) < 0.01  # one step between samples
    harness.run(1.0)
    assert harness.arm.position.tolist() == rest
    assert harness.arm.at_rest
    harness.arm.resume()
    assert not harness.arm.at_rest
    harness.rest()
    assert_within_limits(harness)
    assert_passes(harness, FAST)
    assert not harness.failures


@pytest.mark.parametrize('seconds', one_in(3, [0.1, 0.2, 0.3, 0.4, 0.5]))
def test_hold_of_a_motion_at_its_limits_brakes_soon(seconds):
    """An immediate stop would leave the path."""
    points = curve_points(120, 1.5)
    free, time = free_run(points, period=0.0)
    harness = StreamingHarness()
    harness.send(points, 0.0)
    harness.run(seconds)
    since = len(harness.positions)
    harness.arm.hold()
    assert harness.until_still() < 0.5
    assert farthest(harness.trace[since::10], free.trace) < 0.03  # one step between samples
    harness.arm.resume()
    harness.rest()
    assert len(harness.positions) * DT < time + 0.6
    assert_within_limits(harness)
    assert_passes(harness, points)
    assert not harness.failures


def test_held_arm_accepts_no_points():
    harness = StreamingHarness(look_ahead=0.3)
    harness.send(curve_points(80))
    harness.run(0.4)
    harness.arm.hold()
    assert not harness.arm.has_room
    taken = harness.taken
    harness.run(1.0)
    assert harness.taken == taken < 80
    harness.arm.resume()
    harness.run(0.2)
    assert harness.taken > taken
    harness.rest()
    assert_passes(harness, curve_points(80))


@pytest.mark.parametrize('held', [0.5, 60.0])
def test_time_of_a_hold_is_not_caught_up(held):
    points = curve_points(80)
    free, time = free_run(points)
    harness = held_harness(0.7, points)
    braked, since = len(harness.positions) * DT, len(harness.positions)
    harness.arm.step(held)
    harness.arm.resume()
    total = braked + harness.rest()
    assert time - 0.05 < total < time + 0.15  # two more ramps
    speeds = np.max(np.abs(free.velocities)), np.max(np.abs(harness.velocities[since:]))
    assert speeds[1] < 1.3 * speeds[0]
    assert_within_limits(harness)


@pytest.mark.parametrize('begins', [False, True])
@pytest.mark.parametrize('seconds', one_in(2, [0.0, 0.01, 0.019, 0.02]))
def test_hold_before_the_first_motion_prevents_the_start(seconds, begins):
    """The first plan is not requested, pending, available, or just starting."""
    harness = StreamingHarness(0.02)
    harness.send(FAST)
    harness.run(seconds)
    if begins:
        harness.arm.step(0.0)
    assert not harness.arm.velocity.any()
    assert not harness.arm.at_rest
    harness.arm.hold()
    assert harness.arm.at_rest
    assert harness.arm.moving
    harness.run(0.5)
    assert harness.arm.position.tolist() == HOME.tolist()
    harness.arm.resume()
    harness.rest()
    assert_passes(harness, FAST)
    assert harness.timing.late_plans == 0


@pytest.mark.parametrize('brakes', [0.0, 0.02, 0.1])
def test_stop_ends_a_hold(brakes):
    harness = StreamingHarness()
    harness.send(FAST)
    harness.run(0.5)
    harness.waiting.clear()
    harness.arm.hold()
    harness.run(brakes)
    assert harness.arm.stop()
    harness.run(0.5)
    assert harness.arm.at_rest
    assert not harness.arm.moving
    assert harness.arm.has_room
    assert np.max(np.abs(harness.arm.position - FAST[-1])) > 0.1
    back = np.array([harness.arm.position, HOME])
    harness.send(back, 0.5)
    harness.rest()
    assert_within_limits(harness)
    assert harness.arm.position.tolist() == HOME.tolist()


def test_hold_during_a_stop_does_not_change_the_stop():
    ends = []
    for holds in (False, True):
        harness = StreamingHarness()
        harness.send(FAST)
        harness.run(0.5)
        harness.waiting.clear()
        harness.arm.stop()
        harness.run(0.02)
        if holds:
            harness.arm.hold()
        harness.until_still()
        assert not harness.arm.moving
        assert harness.arm.has_room is not holds
        ends.append(harness.trace)
    assert np.array_equal(*ends)


@pytest.mark.invariant(3)
@pytest.mark.parametrize('answers', [False, True])
def test_inv3_dead_planner_in_a_hold_moves_nothing(answers):
    """Neither braking nor standstill needs a plan."""
    harness = StreamingHarness(0.03)
    harness.send(FAST)
    harness.run(0.5)
    harness.waiting.clear()
    harness.arm.hold()
    if answers:
        harness.run(0.04)
    harness.planner.die()
    harness.until_still(0.25)
    assert harness.arm.moving
    assert harness.arm.stop()  # as the controller does
    assert not harness.arm.moving
    rest = harness.arm.position.tolist()
    harness.planner.ready = True
    harness.run(0.5)
    assert harness.arm.position.tolist() == rest
    harness.send([harness.arm.position, HOME], 0.5)
    harness.rest()
    assert_within_limits(harness)
    assert harness.arm.position.tolist() == HOME.tolist()


def test_resume_without_a_planner_waits_for_it():
    harness = held_harness(0.5)
    rest = harness.arm.position.tolist()
    harness.planner.ready = False
    harness.arm.resume()
    harness.run(1.0)
    assert harness.arm.position.tolist() == rest
    harness.planner.ready = True
    harness.rest()
    assert_passes(harness, FAST)


def test_hold_during_a_commanded_rest_keeps_the_arm_at_its_point():
    points = curve_points(30)
    harness = StreamingHarness()
    harness.send(points[:15])
    harness.send([points[14]], 0.8, first=15)
    harness.send(points[15:], first=16)
    while np.any(harness.arm.position != points[14]):
        harness.run(DT)
    harness.run(0.1)
    assert not harness.arm.at_rest
    harness.arm.hold()
    assert harness.arm.at_rest
    harness.run(2.0)
    assert harness.arm.position.tolist() == points[14].tolist()
    harness.arm.resume()
    harness.rest()
    assert_passes(harness, points)


holds = st.lists(
    st.tuples(st.integers(0, 600), st.sampled_from((0, 1, 20, 100, 400, 600))),
    min_size=1,
    max_size=5,
)  # ms until each hold, and its length


@pytest.mark.slow
@pytest.mark.invariant(2)
@settings(
    max_examples=examples(30),
)
@given(
    holds=holds,
    delay=st.sampled_from([0.0, 0.012, 0.06]),
    period=st.sampled_from([0.0, 0.02, 0.05]),
    look_ahead=st.sampled_from([0.2, 1.0]),
    sparse=st.booleans(),
)
@example(
    holds=[(300, 0), (0, 0), (0, 1), (1, 0)],
    delay=0.012,
    period=0.02,
    look_ahead=1.0,
    sparse=False,
)
def test_inv2_holds_at_random_times_exceed_no_limit(holds, delay, period, look_ahead, sparse):
    points = curve_points(7, 1.5) if sparse else curve_points(50, 0.8)
    harness = StreamingHarness(delay, look_ahead=look_ahead)
    harness.send(points, period * (5.0 if sparse else 1.0))
    for wait, length in holds:
        harness.run(wait * DT)
        harness.arm.hold()
        harness.run(length * DT)
        if length == 600:
            assert harness.arm.at_rest
            assert not harness.arm.velocity.any()
        harness.arm.resume()
    harness.rest()
    assert_within_limits(harness)
    assert_passes(harness, points)
    assert not harness.failures
