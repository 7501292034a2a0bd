# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smooth motion in the core, on a manual clock, with a planner that plans in place."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from support.controller_harness import (
    FAILURE,
    LIMITS,
    MODEL,
    PROFILE,
    STOP,
    SUCCESS,
    Harness,
    InlinePlanner,
    frame,
    point,
)
from support.examples import one_in

from epson_driver.sim_controller.arm.streaming import MAX_ATTEMPTS
from epson_driver.sim_controller.condition.states import Motors

DT = 0.004
HERE = (0.0,) * 6


def smooth_harness(delay=0.0, **settings):
    motion = replace(PROFILE.motion, **settings)
    return Harness(profile=replace(PROFILE, motion=motion), planner=InlinePlanner(delay))


def way(count, period=0.02, amplitude=0.4):
    """Return points of a curve from rest at zero, shape (count, 6), rad."""
    phase = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count))
    shape = np.array([1.0, -0.6, 0.4, 0.8, -0.5, 1.2])
    curve = amplitude * np.outer(phase, shape)
    curve[:, 1] += 0.1 * np.sin(3.0 * np.pi * phase)
    return curve.astype(np.float32).astype(float)


def stream(points, period=0.02, first=0):
    durations = [0.001] + [period] * (len(points) - 1)
    return [
        point(first + index, joints, 0.0, duration)
        for index, (joints, duration) in enumerate(zip(points, durations, strict=True))
    ]


def assert_within_limits(trace, dt=DT):
    assert np.all(trace >= LIMITS.position_min)
    assert np.all(trace <= LIMITS.position_max)
    for order, limit in enumerate((LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk), start=1):
        differences = np.abs(np.diff(trace, order, axis=0)) / dt**order
        assert np.all(differences <= limit * 1.001), f'derivative {order}'


def nearest(trace, points):
    return max(np.min(np.max(np.abs(trace - each), axis=1)) for each in points)


def interior_stops(trace):
    """Count the steps without motion between the first and the last with some."""
    steps = np.max(np.abs(np.diff(trace, axis=0)), axis=1)
    moves = np.flatnonzero(steps > 1e-9)
    return int(np.sum(steps[moves[0] : moves[-1]] <= 1e-9))


# ---- points and flow control


def test_points_are_answered_at_once_while_there_is_room():
    harness = smooth_harness()
    points = way(40)
    harness.send(*stream(points))
    assert harness.codes() == [(i, SUCCESS) for i in range(40)]
    assert harness.controller.status().in_motion == 1
    trace = harness.run()
    assert_within_limits(trace)
    assert harness.joints.tolist() == points[-1].tolist()
    assert harness.controller.status().in_motion == 0
    assert harness.error == 0


def test_the_arm_goes_through_all_points_without_a_stop_and_keeps_the_time():
    harness = smooth_harness()
    points = way(80)
    harness.send(*stream(points))
    trace = harness.run()
    assert interior_stops(trace) == 0
    assert nearest(trace, points) < 0.01
    assert len(trace) * DT < 1.15 * 79 * 0.02 + 0.1


def test_replies_wait_for_room_in_the_order_of_the_points():
    harness = smooth_harness(look_ahead=0.5)
    points = way(200)
    harness.send(*stream(points))
    answered = len(harness.codes())
    assert 26 <= answered <= 31  # half a second; the first points hardly differ
    counts = []
    while harness.controller.moving:
        harness.step(0.1)
        codes = harness.codes()
        assert codes == [(answered + i, SUCCESS) for i in range(len(codes))]
        answered += len(codes)
        counts.append(len(codes))
    assert answered == 200
    assert max(counts) <= 0.1 / 0.02 * 1.2 + 1  # as the arm goes on
    assert harness.joints.tolist() == points[-1].tolist()


def test_the_look_ahead_has_a_limit_of_points_too():
    harness = smooth_harness(look_ahead_points=10)
    harness.send(*stream(way(60, amplitude=1.2)))
    assert len(harness.codes()) == 11  # point 0 is where the arm stands
    harness.rest()
    assert harness.codes() == [(i, SUCCESS) for i in range(11, 60)]


@pytest.mark.parametrize('most', [1, 2])
def test_the_smallest_look_aheads_still_go_through_everything(most):
    harness = smooth_harness(look_ahead_points=most)
    points = way(12)
    harness.send(*stream(points, 0.1))
    harness.rest()
    assert harness.codes() == [(i, SUCCESS) for i in range(12)]
    assert harness.joints.tolist() == points[-1].tolist()


def test_one_point_more_than_may_wait_ends_the_trajectory():
    harness = smooth_harness(look_ahead_points=5, pending_limit=7)
    harness.send(*stream(way(60, amplitude=1.2))[:14])
    codes = harness.codes()
    assert codes[:6] == [(i, SUCCESS) for i in range(6)]
    assert codes[6:] == [(i, FAILURE) for i in range(6, 14)]
    assert harness.error == 8000
    harness.rest()
    assert harness.joints.tolist() == list(HERE)


def test_a_thousand_points_one_after_the_other_as_replies_come():
    """A client that waits for each reply, on a long way of dense points."""
    harness = smooth_harness()
    sent = 0
    frames = stream(way(1000, amplitude=0.8), 0.005)
    harness.send(frames[0])
    trace = [harness.joints]
    while sent < 999 or harness.controller.moving:
        for sequence, code in harness.codes():
            assert (sequence, code) == (sent, SUCCESS)
            if sent < 999:
                sent += 1
                harness.send(frames[sent])
        harness.step(DT)
        trace.append(harness.joints)
        assert len(trace) < 3000
    trace = np.array(trace)
    assert_within_limits(trace)
    assert interior_stops(trace) == 0
    assert len(trace) * DT < 1.15 * 5.0 + 0.2


def test_a_point_where_the_arm_stands_moves_nothing():
    harness = smooth_harness()
    harness.send(point(0), point(1, HERE, 0.0, 0.1), point(2, HERE, 0.5))
    assert harness.codes() == [(0, SUCCESS), (1, SUCCESS), (2, SUCCESS)]
    harness.step(0.5)
    assert not harness.controller.moving
    assert harness.joints.tolist() == list(HERE)


def test_a_tiny_way_is_gone_too():
    harness = smooth_harness()
    harness.send(point(0, (1e-4,) * 6))
    assert harness.codes() == [(0, SUCCESS)]
    assert harness.controller.status().in_motion == 1
    harness.rest()
    assert harness.joints.tolist() == np.float32((1e-4,) * 6).tolist()


def test_a_stream_that_dies_ends_at_rest_at_its_last_point():
    harness = smooth_harness()
    points = way(80)
    harness.send(*stream(points)[:30])
    trace = harness.run()
    assert_within_limits(trace)
    assert harness.joints.tolist() == points[29].tolist()
    harness.send(*stream(points)[30:])  # and goes on
    harness.rest()
    assert harness.joints.tolist() == points[-1].tolist()
    assert harness.codes() == [(i, SUCCESS) for i in range(80)]


@pytest.mark.parametrize(
    ('velocity', 'duration', 'least', 'most'),
    [
        (0.0, 2.0, 2.0, 2.5),  # the duration counts
        (0.9, 2.0, 2.0, 2.5),  # also beside a velocity
        (0.1, 0.0, 10.0 / 9.0, 1.5),  # 1 rad at a tenth of 7.85 rad/s is 1.27 s
        (0.0, 0.0, 0.2, 0.7),  # as fast as the limits allow
        (1.0, 0.0, 0.2, 0.7),
    ],
)
def test_duration_and_velocity_of_a_point(velocity, duration, least, most):
    harness = smooth_harness()
    harness.send(point(0), point(1, (1.0, 0, 0, 0, 0, 0), velocity, duration))
    assert least <= harness.rest() <= most


def test_speed_percent_is_not_for_smooth_motion():
    times = []
    for speed in (0.01, 1.0):
        harness = smooth_harness(speed=speed, accel=speed)
        harness.send(point(0), point(1, (1.0,)))
        times.append(harness.rest())
    assert times[0] == times[1]


def test_sequence_0_again_begins_a_new_trajectory_after_a_rest():
    harness = smooth_harness()
    points = way(20)
    harness.send(*stream(points))
    harness.step(0.1)
    harness.send(point(0, points[-1], 0.0, 0.02), *stream(points[::-1])[1:])
    trace = harness.run()
    assert_within_limits(trace)
    turn = int(np.argmax(trace[:, 0]))
    assert trace[turn].tolist() == pytest.approx(points[-1].tolist(), abs=1e-4)
    assert harness.joints.tolist() == points[0].tolist()
    assert [code for _, code in harness.codes()] == [SUCCESS] * 40


# ---- stops


def moving_harness(delay=0.0, count=80, **settings):
    """Return a harness in mid-motion, all points answered unless the settings forbid it."""
    harness = smooth_harness(delay, **settings)
    harness.send(*stream(way(count)))
    harness.step(0.7)
    assert harness.controller.moving
    assert 0.0 < harness.joints[0] < 0.4
    harness.codes()
    return harness


@pytest.mark.invariant(3)
@pytest.mark.parametrize('delay', [0.0, 0.03])
def test_invariant_3_stop_flushes_and_brings_to_rest(delay):
    harness = moving_harness(delay, look_ahead=0.3)
    waiting = 80 - len(harness.codes())
    assert waiting
    harness.send(point(STOP))
    codes = harness.codes()
    assert codes[-1] == (STOP, SUCCESS)
    assert {code for _, code in codes[:-1]} == {FAILURE}
    trace = harness.run(most=1.0)
    assert_within_limits(trace)
    assert harness.joints[0] < 0.39
    harness.step(1.0)
    assert harness.joints.tolist() == trace[-1].tolist()
    assert harness.error == 0
    harness.send(point(79, HERE))  # the trajectory is over
    assert harness.codes() == [(79, FAILURE)]
    harness.send(point(0, HERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]
    assert harness.joints.tolist() == list(HERE)


def test_points_after_a_stop_wait_until_the_arm_rests():
    harness = moving_harness()
    harness.send(point(STOP), point(0, HERE))
    assert harness.codes() == [(STOP, SUCCESS)]
    trace = harness.run()
    assert_within_limits(trace)
    assert harness.codes() == [(0, SUCCESS)]
    assert harness.joints.tolist() == list(HERE)
    assert interior_stops(trace) > 0


def test_stop_before_the_arm_has_begun():
    harness = smooth_harness(delay=0.02)
    harness.send(*stream(way(80)))
    harness.step(0.02)  # a plan is on its way
    harness.send(point(STOP))
    harness.step(1.0)
    assert harness.joints.tolist() == list(HERE)
    assert not harness.controller.moving
    assert harness.controller.timing.late_plans == 0


def test_a_refused_point_ends_the_trajectory_and_none_is_skipped():
    harness = moving_harness()
    harness.send(point(77, HERE))
    assert harness.codes() == [(77, FAILURE)]
    assert harness.error == 8000
    trace = harness.run(most=1.0)
    assert_within_limits(trace)
    assert harness.joints[0] < 0.39
    harness.send(point(80, way(80)[-1]))  # what was answered before it was not reached
    assert harness.codes() == [(80, FAILURE)]
    harness.send(point(0, HERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]
    assert harness.error == 0


def test_a_refused_point_at_rest_does_not_end_the_trajectory():
    harness = smooth_harness()
    harness.send(point(0), point(1, (0.2,), 0.0, 0.5))
    harness.rest()
    harness.codes()
    harness.send(point(7, HERE), point(2, (9.0,)), frame(11, 2, 0), point(2, HERE))
    assert harness.codes() == [(7, FAILURE), (2, FAILURE), (0, FAILURE), (2, SUCCESS)]
    harness.rest()
    assert harness.joints.tolist() == list(HERE)


def test_a_duration_of_more_than_a_day_is_refused():
    harness = smooth_harness()
    harness.send(point(0), point(1, (0.1,), 0.0, 1e5))
    assert harness.codes() == [(0, SUCCESS), (1, FAILURE)]
    assert harness.error == 8000


@pytest.mark.invariant(3, 4)
def test_invariant_3_and_4_estop_in_motion():
    harness = moving_harness(look_ahead=0.3)
    harness.do('E-stop press')
    assert {code for _, code in harness.codes()} == {FAILURE}
    assert harness.controller.status().drives_powered == 0
    trace = harness.run(most=1.0)
    assert_within_limits(trace)
    harness.do('E-stop release', 'reset', 'motors on')
    harness.step(1.0)
    assert harness.joints.tolist() == trace[-1].tolist()
    harness.send(point(40, HERE))
    assert harness.codes() == [(40, FAILURE)]


@pytest.mark.invariant(3)
@pytest.mark.parametrize('how', ['motors off', 'client lost'])
def test_invariant_3_motors_off_and_a_lost_client_brake_first(how):
    harness = moving_harness(delay=0.02)
    if how == 'motors off':
        harness.do('motors off')
    else:
        harness.disconnect()
    assert harness.condition.motors is Motors.BRAKING
    trace = harness.run(most=1.0)
    assert_within_limits(trace)
    assert harness.condition.motors is Motors.OFF
    harness.step(1.0)
    assert harness.joints.tolist() == trace[-1].tolist()


@pytest.mark.invariant(1)
def test_invariant_1_no_plan_from_before_a_stop_moves_the_arm():
    """The answer comes when the arm rests again and there are other points."""
    harness = smooth_harness(delay=0.2)
    harness.send(*stream(way(80)))
    harness.step(0.1)
    harness.send(point(STOP), *stream([HERE, (0.0, 0.05, 0, 0, 0, 0)], 0.3))
    trace = harness.run()
    assert_within_limits(trace)
    assert np.all(trace[:, 0] == 0.0)
    assert harness.joints[1] == np.float32(0.05)


# ---- pauses and power


@pytest.mark.parametrize('seconds', one_in(3, [0.02, 0.3, 0.7, 1.2]))
def test_a_pause_brakes_on_the_path_and_continue_goes_on_to_the_same_points(seconds):
    harness = smooth_harness(0.012, look_ahead=0.3)
    points = way(80)
    harness.send(*stream(points))
    harness.step(seconds)
    harness.do('pause')
    before = harness.run(most=0.3)
    assert harness.controller.status().in_motion == 0
    answered = harness.codes()
    assert len(answered) < 80
    harness.step(1.0)
    assert harness.joints.tolist() == before[-1].tolist()
    assert harness.codes() == []
    harness.do('continue')
    after = harness.run()
    for trace in (before, after):
        assert_within_limits(trace)
    assert harness.joints.tolist() == points[-1].tolist()
    assert answered + harness.codes() == [(i, SUCCESS) for i in range(80)]
    assert harness.error == 0


@pytest.mark.invariant(3, 4)
def test_invariant_3_and_4_estop_in_a_pause_ends_the_trajectory():
    harness = moving_harness()
    harness.do('pause')
    harness.run(most=0.3)
    stands = harness.joints.tolist()
    harness.do('E-stop press', 'E-stop release', 'reset', 'motors on')
    harness.step(1.0)
    assert harness.joints.tolist() == stands
    harness.send(point(80, HERE))
    assert [code for _, code in harness.codes()] == [FAILURE]


@pytest.mark.invariant(2)
def test_invariant_2_low_power_keeps_the_tool_slow():
    harness = smooth_harness(power='low')
    points = way(20, amplitude=0.1)
    harness.send(*stream(points))
    trace = harness.run()
    velocities = np.abs(np.diff(trace, axis=0)) / DT
    assert np.all(velocities <= 0.05 * LIMITS.velocity * 1.001)
    assert 0.1 < np.max(velocities @ MODEL.reach) <= 0.25
    assert harness.joints.tolist() == points[-1].tolist()


# ---- the planner


@pytest.mark.parametrize('delay', [0.008, 0.02, 0.06, 0.12])
def test_a_slow_planner_delays_nothing_but_itself(delay):
    harness = smooth_harness(delay)
    points = way(80)
    harness.send(*stream(points))
    trace = harness.run()
    assert_within_limits(trace)
    assert nearest(trace, points) < 0.01
    assert harness.joints.tolist() == points[-1].tolist()


def test_late_plans_are_counted_and_told_once(caplog):
    caplog.set_level(logging.INFO)
    harness = smooth_harness(0.004)
    points = way(150)
    harness.send(*stream(points))
    harness.step(0.3)
    harness.planner.delay = 0.1  # longer than the latency by then
    harness.step(0.5)
    harness.planner.delay = 0.004
    trace = harness.run()
    assert_within_limits(trace)
    late = harness.controller.timing.late_plans
    assert late >= 1
    assert harness.joints.tolist() == points[-1].tolist()
    text = f'in this motion: {late} plan(s) came too late and were not used'
    assert caplog.text.count(text) == 1
    caplog.clear()
    harness.send(*stream(points[::-1]))
    harness.rest()
    assert 'in this motion' not in caplog.text
    assert harness.remote('Sim,timing') == [f'#Sim,0,{late},0,0']


@pytest.mark.invariant(3, 4)
def test_invariant_3_and_4_a_planner_that_dies_in_motion_stops_the_arm(caplog):
    harness = moving_harness(delay=0.02, look_ahead=0.3)
    harness.planner.die()
    harness.controller.planner_failed('was ended by SIGKILL')
    assert {code for _, code in harness.codes()} == {FAILURE}
    assert harness.error == 8001
    assert 'refused (8001): the motion planner: was ended by SIGKILL' in caplog.text
    trace = harness.run(most=1.0)
    assert_within_limits(trace)
    harness.send(point(0, HERE))
    assert harness.codes() == [(0, FAILURE)]
    assert 'starts again' in caplog.text
    harness.planner.ready = True
    harness.step(2.0)
    assert harness.joints.tolist() == trace[-1].tolist()
    harness.send(point(50, HERE))
    assert harness.codes() == [(50, FAILURE)]
    harness.send(point(0, HERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]
    assert harness.joints.tolist() == list(HERE)
    assert harness.error == 0
    assert harness.controller.timing.planner_failures == 1


def test_a_planner_that_dies_while_the_arm_rests():
    harness = smooth_harness()
    harness.planner.die()
    harness.controller.planner_failed('ended with exit code 1')
    assert not harness.controller.moving
    assert harness.error == 8001
    assert harness.controller.status().motion_possible == 0
    harness.send(point(0, (0.1,)))
    assert harness.codes() == [(0, FAILURE)]
    harness.planner.ready = True
    harness.do('reset')
    assert harness.error == 0
    harness.send(point(0, (0.1,)))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


def test_with_the_motors_off_it_is_the_motors_that_are_told():
    harness = Harness(motors=False, planner=InlinePlanner())
    harness.planner.ready = False
    harness.send(point(0, (0.1,)))
    assert harness.error == 4031


def test_a_planner_that_finds_nothing_is_a_failure_after_some_attempts():
    harness = smooth_harness()
    harness.planner.plan = lambda request, limits: None
    harness.send(*stream(way(10)))
    harness.rest(most=1.0)
    assert harness.planner.asked == MAX_ATTEMPTS
    assert harness.error == 8001
    assert harness.joints.tolist() == list(HERE)


def test_a_planner_that_finds_nothing_in_motion_lets_the_plan_so_far_end():
    harness = moving_harness(count=400)
    harness.planner.plan = lambda request, limits: None
    trace = harness.run()
    assert_within_limits(trace)
    assert harness.error == 8001  # at rest then, before the last point
    assert harness.joints[0] < 0.39


# ---- time


def test_the_same_calls_give_the_same_motion():
    traces = []
    for _ in range(2):
        harness = smooth_harness(0.012)
        harness.send(*stream(way(60)))
        traces.append(harness.run())
    assert np.array_equal(*traces)


def test_a_long_step_ends_at_rest_on_the_plan_and_goes_on():
    harness = moving_harness(count=200, look_ahead=0.6)
    before = harness.joints
    harness.controller.step(30.0)  # the machine was away
    assert np.all(np.abs(harness.joints - before) < 0.4)
    harness.rest()
    assert harness.joints.tolist() == way(200)[-1].tolist()
    assert harness.codes()[-1] == (199, SUCCESS)


def test_time_that_passes_at_rest_does_not_count():
    harness = smooth_harness()
    harness.send(point(0))
    harness.controller.step(3600.0)
    harness.send(*stream(way(40))[1:])
    assert 0.7 < harness.rest() < 1.1
