# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Pauses of smooth motion: on the path, inside every limit, and on to the same points."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from streaming_bench import (
    DT,
    HOME,
    LIMITS,
    StreamingBench,
    assert_passes,
    assert_within_limits,
    way,
)
from support.examples import examples

FAST = way(60, 1.0)
"""Points for which PERIOD is too short: the arm is as fast as its limits allow."""


def free_run(points, **values):
    bench = StreamingBench()
    bench.send(points, **values)
    return bench, bench.rest()


def held_bench(seconds, points=FAST, **values):
    """Return a bench whose arm has been held in mid-motion, and stands."""
    bench = StreamingBench(**values)
    bench.send(points)
    bench.run(seconds)
    assert bench.velocities[-1].any()
    bench.arm.hold()
    bench.until_still()
    return bench


def farthest(trace, others):
    """Return how far the trace goes from the samples of another one, rad."""
    return max(np.min(np.max(np.abs(others - each), axis=1)) for each in trace)


@pytest.mark.invariant(2, 3)
@pytest.mark.parametrize('delay', [0.0, 0.012, 0.1])
@pytest.mark.parametrize('seconds', [0.25, 0.35, 0.5, 0.8, 1.1])
def test_invariant_2_and_3_a_hold_brakes_on_the_path_and_keeps_all_points(seconds, delay):
    free, _ = free_run(FAST)
    bench = StreamingBench(delay)
    bench.send(FAST)
    bench.run(seconds)
    assert np.max(np.abs(bench.arm.velocity) / LIMITS.velocity) > 0.05
    since = len(bench.positions)
    bench.arm.hold()
    assert not bench.arm.still
    assert bench.until_still() < 0.25  # at once, however slow the planner is
    assert bench.arm.moving
    assert not bench.arm.velocity.any()
    stands = bench.arm.position.tolist()
    assert farthest(bench.trace[since::10], free.trace) < 0.01  # a step's way between samples
    bench.run(1.0)
    assert bench.arm.position.tolist() == stands
    assert bench.arm.still
    bench.arm.resume()
    assert not bench.arm.still
    bench.rest()
    assert_within_limits(bench)
    assert_passes(bench, FAST)
    assert not bench.failures


@pytest.mark.parametrize('seconds', [0.1, 0.2, 0.3, 0.4, 0.5])
def test_a_hold_of_a_motion_that_uses_its_limits_to_the_full(seconds):
    """It cannot always brake at once without leaving the path, but soon."""
    points = way(120, 1.5)
    free, time = free_run(points, period=0.0)
    bench = StreamingBench()
    bench.send(points, 0.0)
    bench.run(seconds)
    since = len(bench.positions)
    bench.arm.hold()
    assert bench.until_still() < 0.5
    assert farthest(bench.trace[since::10], free.trace) < 0.03  # a step's way between samples
    bench.arm.resume()
    bench.rest()
    assert len(bench.positions) * DT < time + 0.6
    assert_within_limits(bench)
    assert_passes(bench, points)
    assert not bench.failures


def test_no_point_is_taken_while_it_is_held():
    bench = StreamingBench(look_ahead=0.3)
    bench.send(way(80))
    bench.run(0.4)
    bench.arm.hold()
    assert not bench.arm.has_room
    taken = bench.taken
    bench.run(1.0)
    assert bench.taken == taken < 80
    bench.arm.resume()
    bench.run(0.2)
    assert bench.taken > taken
    bench.rest()
    assert_passes(bench, way(80))


@pytest.mark.parametrize('held', [0.5, 60.0])
def test_the_time_of_a_hold_is_not_made_up_for(held):
    points = way(80)
    free, time = free_run(points)
    bench = held_bench(0.7, points)
    braked, since = len(bench.positions) * DT, len(bench.positions)
    bench.arm.step(held)
    bench.arm.resume()
    total = braked + bench.rest()
    assert time - 0.05 < total < time + 0.15  # two more ramps
    speeds = np.max(np.abs(free.velocities)), np.max(np.abs(bench.velocities[since:]))
    assert speeds[1] < 1.3 * speeds[0]
    assert_within_limits(bench)


def test_a_hold_twice_and_a_resume_twice_are_no_more_than_one():
    bench = held_bench(0.5)
    stands = bench.arm.position.tolist()
    bench.arm.hold()
    bench.run(0.3)
    assert bench.arm.position.tolist() == stands
    bench.arm.resume()
    bench.arm.resume()
    bench.rest()
    assert_passes(bench, FAST)


def test_a_resume_without_a_hold_changes_nothing():
    traces = []
    for resumes in (False, True):
        bench = StreamingBench()
        bench.send(FAST)
        bench.run(0.4)
        if resumes:
            bench.arm.resume()
        bench.rest()
        traces.append(bench.trace)
    assert np.array_equal(*traces)


@pytest.mark.parametrize('begins', [False, True])
@pytest.mark.parametrize('seconds', [0.0, 0.01, 0.019, 0.02])
def test_an_arm_that_stands_when_it_is_held_does_not_begin(seconds, begins):
    """Whether the first plan is not asked for, is on its way, is there, or begins just now."""
    bench = StreamingBench(0.02)
    bench.send(FAST)
    bench.run(seconds)
    if begins:
        bench.arm.step(0.0)
    assert not bench.arm.velocity.any()
    assert not bench.arm.still
    bench.arm.hold()
    assert bench.arm.still
    assert bench.arm.moving
    bench.run(0.5)
    assert bench.arm.position.tolist() == HOME.tolist()
    bench.arm.resume()
    bench.rest()
    assert_passes(bench, FAST)
    assert bench.timing.late_plans == 0


def test_an_arm_held_without_points_takes_them_after_the_hold():
    bench = StreamingBench()
    bench.arm.hold()
    assert bench.arm.still
    assert not bench.arm.moving
    assert not bench.arm.has_room
    bench.run(0.5)
    bench.send(FAST)
    assert bench.taken == 0
    bench.arm.resume()
    assert bench.arm.has_room
    bench.rest()
    assert_passes(bench, FAST)


@pytest.mark.parametrize('brakes', [0.0, 0.02, 0.1])
def test_a_stop_ends_a_hold(brakes):
    bench = StreamingBench()
    bench.send(FAST)
    bench.run(0.5)
    bench.waiting.clear()
    bench.arm.hold()
    bench.run(brakes)
    assert bench.arm.stop()
    bench.run(0.5)
    assert bench.arm.still
    assert not bench.arm.moving
    assert bench.arm.has_room
    assert np.max(np.abs(bench.arm.position - FAST[-1])) > 0.1
    back = np.array([bench.arm.position, HOME])
    bench.send(back, 0.5)
    bench.rest()
    assert_within_limits(bench)
    assert bench.arm.position.tolist() == HOME.tolist()


def test_a_hold_while_the_arm_brakes_for_a_stop_changes_nothing_of_that():
    ends = []
    for holds in (False, True):
        bench = StreamingBench()
        bench.send(FAST)
        bench.run(0.5)
        bench.waiting.clear()
        bench.arm.stop()
        bench.run(0.02)
        if holds:
            bench.arm.hold()
        bench.until_still()
        assert not bench.arm.moving
        assert bench.arm.has_room is not holds
        ends.append(bench.trace)
    assert np.array_equal(*ends)


@pytest.mark.invariant(3)
@pytest.mark.parametrize('answers', [False, True])
def test_invariant_3_a_planner_that_dies_in_a_hold(answers):
    """The arm stays, or brakes on; nothing of it needs a plan."""
    bench = StreamingBench(0.03)
    bench.send(FAST)
    bench.run(0.5)
    bench.waiting.clear()
    bench.arm.hold()
    if answers:
        bench.run(0.04)
    bench.planner.die()
    bench.until_still(0.25)
    assert bench.arm.moving
    assert bench.arm.stop()  # as the controller does
    assert not bench.arm.moving
    stands = bench.arm.position.tolist()
    bench.planner.ready = True
    bench.run(0.5)
    assert bench.arm.position.tolist() == stands
    bench.send([bench.arm.position, HOME], 0.5)
    bench.rest()
    assert_within_limits(bench)
    assert bench.arm.position.tolist() == HOME.tolist()


def test_without_a_planner_after_a_hold_the_arm_stays():
    bench = held_bench(0.5)
    stands = bench.arm.position.tolist()
    bench.planner.ready = False
    bench.arm.resume()
    bench.run(1.0)
    assert bench.arm.position.tolist() == stands
    bench.planner.ready = True
    bench.rest()
    assert_passes(bench, FAST)


def test_a_hold_in_a_commanded_rest():
    points = way(30)
    bench = StreamingBench()
    bench.send(points[:15])
    bench.send([points[14]], 0.8, first=15)
    bench.send(points[15:], first=16)
    while np.any(bench.arm.position != points[14]):
        bench.run(DT)
    bench.run(0.1)
    assert not bench.arm.still
    bench.arm.hold()
    assert bench.arm.still
    bench.run(2.0)
    assert bench.arm.position.tolist() == points[14].tolist()
    bench.arm.resume()
    bench.rest()
    assert_passes(bench, points)


holds = st.lists(
    st.tuples(st.integers(0, 600), st.sampled_from((0, 1, 20, 100, 400, 600))),
    min_size=1,
    max_size=5,
)  # ms until each hold, and how long it lasts


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
def test_invariant_2_holds_at_any_time(holds, delay, period, look_ahead, sparse):
    points = way(7, 1.5) if sparse else way(50, 0.8)
    bench = StreamingBench(delay, look_ahead=look_ahead)
    bench.send(points, period * (5.0 if sparse else 1.0))
    for wait, length in holds:
        bench.run(wait * DT)
        bench.arm.hold()
        bench.run(length * DT)
        if length == 600:
            assert bench.arm.still
            assert not bench.arm.velocity.any()
        bench.arm.resume()
    bench.rest()
    assert_within_limits(bench)
    assert_passes(bench, points)
    assert not bench.failures
