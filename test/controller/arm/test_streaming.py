# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smooth motion in the core, on a manual clock, with a planner that plans in place."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from controller_bench import (
    FAILURE,
    LIMITS,
    MODEL,
    PROFILE,
    STOP,
    SUCCESS,
    Bench,
    InlinePlanner,
    frame,
    point,
)

from epson_driver.controller.arm.streaming import ATTEMPTS
from epson_driver.controller.states import Motors

DT = 0.004
HERE = (0.0,) * 6


def smooth_bench(delay=0.0, **settings):
    motion = replace(PROFILE.motion, **settings)
    return Bench(profile=replace(PROFILE, motion=motion), planner=InlinePlanner(delay))


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
    bench = smooth_bench()
    points = way(40)
    bench.send(*stream(points))
    assert bench.codes() == [(i, SUCCESS) for i in range(40)]
    assert bench.controller.status().in_motion == 1
    trace = bench.run()
    assert_within_limits(trace)
    assert bench.joints.tolist() == points[-1].tolist()
    assert bench.controller.status().in_motion == 0
    assert bench.error == 0


def test_the_arm_goes_through_all_points_without_a_stop_and_keeps_the_time():
    bench = smooth_bench()
    points = way(80)
    bench.send(*stream(points))
    trace = bench.run()
    assert interior_stops(trace) == 0
    assert nearest(trace, points) < 0.01
    assert len(trace) * DT < 1.15 * 79 * 0.02 + 0.1


def test_replies_wait_for_room_in_the_order_of_the_points():
    bench = smooth_bench(look_ahead=0.5)
    points = way(200)
    bench.send(*stream(points))
    answered = len(bench.codes())
    assert 26 <= answered <= 31  # half a second; the first points hardly differ
    counts = []
    while bench.controller.moving:
        bench.step(0.1)
        codes = bench.codes()
        assert codes == [(answered + i, SUCCESS) for i in range(len(codes))]
        answered += len(codes)
        counts.append(len(codes))
    assert answered == 200
    assert max(counts) <= 0.1 / 0.02 * 1.2 + 1  # as the arm goes on
    assert bench.joints.tolist() == points[-1].tolist()


def test_the_look_ahead_has_a_limit_of_points_too():
    bench = smooth_bench(look_ahead_points=10)
    bench.send(*stream(way(60)))
    assert len(bench.codes()) == 11  # point 0 is where the arm stands
    bench.rest()
    assert bench.codes() == [(i, SUCCESS) for i in range(11, 60)]


@pytest.mark.parametrize('most', [1, 2])
def test_the_smallest_look_aheads_still_go_through_everything(most):
    bench = smooth_bench(look_ahead_points=most)
    points = way(12)
    bench.send(*stream(points, 0.1))
    bench.rest()
    assert bench.codes() == [(i, SUCCESS) for i in range(12)]
    assert bench.joints.tolist() == points[-1].tolist()


def test_one_point_more_than_may_wait_ends_the_trajectory():
    bench = smooth_bench(look_ahead_points=5, pending_limit=7)
    bench.send(*stream(way(60))[:14])
    codes = bench.codes()
    assert codes[:6] == [(i, SUCCESS) for i in range(6)]
    assert codes[6:] == [(i, FAILURE) for i in range(6, 14)]
    assert bench.error == 8000
    bench.rest()
    assert bench.joints.tolist() == list(HERE)


def test_a_thousand_points_one_after_the_other_as_replies_come():
    """A client that waits for each reply, on a long way of dense points."""
    bench = smooth_bench()
    sent = 0
    frames = stream(way(1000, amplitude=0.8), 0.005)
    bench.send(frames[0])
    trace = [bench.joints]
    while sent < 999 or bench.controller.moving:
        for sequence, code in bench.codes():
            assert (sequence, code) == (sent, SUCCESS)
            if sent < 999:
                sent += 1
                bench.send(frames[sent])
        bench.step(DT)
        trace.append(bench.joints)
        assert len(trace) < 3000
    trace = np.array(trace)
    assert_within_limits(trace)
    assert interior_stops(trace) == 0
    assert len(trace) * DT < 1.15 * 5.0 + 0.2


def test_a_point_where_the_arm_stands_moves_nothing():
    bench = smooth_bench()
    bench.send(point(0), point(1, HERE, 0.0, 0.1), point(2, HERE, 0.5))
    assert bench.codes() == [(0, SUCCESS), (1, SUCCESS), (2, SUCCESS)]
    bench.step(0.5)
    assert not bench.controller.moving
    assert bench.joints.tolist() == list(HERE)


def test_a_tiny_way_is_gone_too():
    bench = smooth_bench()
    bench.send(point(0, (1e-4,) * 6))
    assert bench.codes() == [(0, SUCCESS)]
    assert bench.controller.status().in_motion == 1
    bench.rest()
    assert bench.joints.tolist() == np.float32((1e-4,) * 6).tolist()


def test_a_stream_that_dies_ends_at_rest_at_its_last_point():
    bench = smooth_bench()
    points = way(80)
    bench.send(*stream(points)[:30])
    trace = bench.run()
    assert_within_limits(trace)
    assert bench.joints.tolist() == points[29].tolist()
    bench.send(*stream(points)[30:])  # and goes on
    bench.rest()
    assert bench.joints.tolist() == points[-1].tolist()
    assert bench.codes() == [(i, SUCCESS) for i in range(80)]


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
    bench = smooth_bench()
    bench.send(point(0), point(1, (1.0, 0, 0, 0, 0, 0), velocity, duration))
    assert least <= bench.rest() <= most


def test_speed_percent_is_not_for_smooth_motion():
    times = []
    for speed in (0.01, 1.0):
        bench = smooth_bench(speed=speed, accel=speed)
        bench.send(point(0), point(1, (1.0,)))
        times.append(bench.rest())
    assert times[0] == times[1]


def test_sequence_0_again_begins_a_new_trajectory_after_a_rest():
    bench = smooth_bench()
    points = way(20)
    bench.send(*stream(points))
    bench.step(0.1)
    bench.send(point(0, points[-1], 0.0, 0.02), *stream(points[::-1])[1:])
    trace = bench.run()
    assert_within_limits(trace)
    turn = int(np.argmax(trace[:, 0]))
    assert trace[turn].tolist() == pytest.approx(points[-1].tolist(), abs=1e-4)
    assert bench.joints.tolist() == points[0].tolist()
    assert [code for _, code in bench.codes()] == [SUCCESS] * 40


# ---- stops


def moving_bench(delay=0.0, count=80, **settings):
    """Return a bench in mid-motion, all points answered unless the settings forbid it."""
    bench = smooth_bench(delay, **settings)
    bench.send(*stream(way(count)))
    bench.step(0.7)
    assert bench.controller.moving
    assert 0.0 < bench.joints[0] < 0.4
    bench.codes()
    return bench


@pytest.mark.invariant(3)
@pytest.mark.parametrize('delay', [0.0, 0.03])
def test_invariant_3_stop_flushes_and_brings_to_rest(delay):
    bench = moving_bench(delay, look_ahead=0.3)
    waiting = 80 - len(bench.codes())
    assert waiting
    bench.send(point(STOP))
    codes = bench.codes()
    assert codes[-1] == (STOP, SUCCESS)
    assert {code for _, code in codes[:-1]} == {FAILURE}
    trace = bench.run(most=1.0)
    assert_within_limits(trace)
    assert bench.joints[0] < 0.39
    bench.step(1.0)
    assert bench.joints.tolist() == trace[-1].tolist()
    assert bench.error == 0
    bench.send(point(79, HERE))  # the trajectory is over
    assert bench.codes() == [(79, FAILURE)]
    bench.send(point(0, HERE))
    bench.rest()
    assert bench.codes() == [(0, SUCCESS)]
    assert bench.joints.tolist() == list(HERE)


def test_points_after_a_stop_wait_until_the_arm_rests():
    bench = moving_bench()
    bench.send(point(STOP), point(0, HERE))
    assert bench.codes() == [(STOP, SUCCESS)]
    trace = bench.run()
    assert_within_limits(trace)
    assert bench.codes() == [(0, SUCCESS)]
    assert bench.joints.tolist() == list(HERE)
    assert interior_stops(trace) > 0


def test_stop_before_the_arm_has_begun():
    bench = smooth_bench(delay=0.02)
    bench.send(*stream(way(80)))
    bench.step(0.02)  # a plan is on its way
    bench.send(point(STOP))
    bench.step(1.0)
    assert bench.joints.tolist() == list(HERE)
    assert not bench.controller.moving
    assert bench.controller.timing.late_plans == 0


def test_a_refused_point_ends_the_trajectory_and_none_is_skipped():
    bench = moving_bench()
    bench.send(point(77, HERE))
    assert bench.codes() == [(77, FAILURE)]
    assert bench.error == 8000
    trace = bench.run(most=1.0)
    assert_within_limits(trace)
    assert bench.joints[0] < 0.39
    bench.send(point(80, way(80)[-1]))  # what was answered before it was not reached
    assert bench.codes() == [(80, FAILURE)]
    bench.send(point(0, HERE))
    bench.rest()
    assert bench.codes() == [(0, SUCCESS)]
    assert bench.error == 0


def test_a_refused_point_at_rest_does_not_end_the_trajectory():
    bench = smooth_bench()
    bench.send(point(0), point(1, (0.2,), 0.0, 0.5))
    bench.rest()
    bench.codes()
    bench.send(point(7, HERE), point(2, (9.0,)), frame(11, 2, 0), point(2, HERE))
    assert bench.codes() == [(7, FAILURE), (2, FAILURE), (0, FAILURE), (2, SUCCESS)]
    bench.rest()
    assert bench.joints.tolist() == list(HERE)


def test_a_duration_of_more_than_a_day_is_refused():
    bench = smooth_bench()
    bench.send(point(0), point(1, (0.1,), 0.0, 1e5))
    assert bench.codes() == [(0, SUCCESS), (1, FAILURE)]
    assert bench.error == 8000


@pytest.mark.invariant(3, 4)
def test_invariant_3_and_4_estop_in_motion():
    bench = moving_bench(look_ahead=0.3)
    bench.do('E-stop press')
    assert {code for _, code in bench.codes()} == {FAILURE}
    assert bench.controller.status().drives_powered == 0
    trace = bench.run(most=1.0)
    assert_within_limits(trace)
    bench.do('E-stop release', 'reset', 'motors on')
    bench.step(1.0)
    assert bench.joints.tolist() == trace[-1].tolist()
    bench.send(point(40, HERE))
    assert bench.codes() == [(40, FAILURE)]


@pytest.mark.invariant(3)
@pytest.mark.parametrize('how', ['motors off', 'client lost'])
def test_invariant_3_motors_off_and_a_lost_client_brake_first(how):
    bench = moving_bench(delay=0.02)
    if how == 'motors off':
        bench.do('motors off')
    else:
        bench.disconnect()
    assert bench.condition.motors is Motors.BRAKING
    trace = bench.run(most=1.0)
    assert_within_limits(trace)
    assert bench.condition.motors is Motors.OFF
    bench.step(1.0)
    assert bench.joints.tolist() == trace[-1].tolist()


@pytest.mark.invariant(1)
def test_invariant_1_no_plan_from_before_a_stop_moves_the_arm():
    """The answer comes when the arm rests again and there are other points."""
    bench = smooth_bench(delay=0.2)
    bench.send(*stream(way(80)))
    bench.step(0.1)
    bench.send(point(STOP), *stream([HERE, (0.0, 0.05, 0, 0, 0, 0)], 0.3))
    trace = bench.run()
    assert_within_limits(trace)
    assert np.all(trace[:, 0] == 0.0)
    assert bench.joints[1] == np.float32(0.05)


# ---- pauses and power


@pytest.mark.parametrize('seconds', [0.02, 0.3, 0.7, 1.2])
def test_a_pause_brakes_on_the_path_and_continue_goes_on_to_the_same_points(seconds):
    bench = smooth_bench(0.012, look_ahead=0.3)
    points = way(80)
    bench.send(*stream(points))
    bench.step(seconds)
    bench.do('pause')
    before = bench.run(most=0.3)
    assert bench.controller.status().in_motion == 0
    answered = bench.codes()
    assert len(answered) < 80
    bench.step(1.0)
    assert bench.joints.tolist() == before[-1].tolist()
    assert bench.codes() == []
    bench.do('continue')
    after = bench.run()
    for trace in (before, after):
        assert_within_limits(trace)
    assert bench.joints.tolist() == points[-1].tolist()
    assert answered + bench.codes() == [(i, SUCCESS) for i in range(80)]
    assert bench.error == 0


@pytest.mark.invariant(3, 4)
def test_invariant_3_and_4_estop_in_a_pause_ends_the_trajectory():
    bench = moving_bench()
    bench.do('pause')
    bench.run(most=0.3)
    stands = bench.joints.tolist()
    bench.do('E-stop press', 'E-stop release', 'reset', 'motors on')
    bench.step(1.0)
    assert bench.joints.tolist() == stands
    bench.send(point(80, HERE))
    assert [code for _, code in bench.codes()] == [FAILURE]


@pytest.mark.invariant(2)
def test_invariant_2_low_power_keeps_the_tool_slow():
    bench = smooth_bench(power='low')
    points = way(20, amplitude=0.1)
    bench.send(*stream(points))
    trace = bench.run()
    velocities = np.abs(np.diff(trace, axis=0)) / DT
    assert np.all(velocities <= 0.05 * LIMITS.velocity * 1.001)
    assert 0.1 < np.max(velocities @ MODEL.reach) <= 0.25
    assert bench.joints.tolist() == points[-1].tolist()


# ---- the planner


@pytest.mark.parametrize('delay', [0.008, 0.02, 0.06, 0.12])
def test_a_slow_planner_delays_nothing_but_itself(delay):
    bench = smooth_bench(delay)
    points = way(80)
    bench.send(*stream(points))
    trace = bench.run()
    assert_within_limits(trace)
    assert nearest(trace, points) < 0.01
    assert bench.joints.tolist() == points[-1].tolist()


def test_late_plans_are_counted_and_told_once(caplog):
    caplog.set_level(logging.INFO)
    bench = smooth_bench(0.004)
    points = way(150)
    bench.send(*stream(points))
    bench.step(0.3)
    bench.planner.delay = 0.1  # longer than the latency by then
    bench.step(0.5)
    bench.planner.delay = 0.004
    trace = bench.run()
    assert_within_limits(trace)
    late = bench.controller.timing.late_plans
    assert late >= 1
    assert bench.joints.tolist() == points[-1].tolist()
    text = f'in this motion: {late} plan(s) came too late and were not used'
    assert caplog.text.count(text) == 1
    caplog.clear()
    bench.send(*stream(points[::-1]))
    bench.rest()
    assert 'in this motion' not in caplog.text
    assert bench.remote('Sim,timing') == [f'#Sim,0,{late},0,0']


@pytest.mark.invariant(3, 4)
def test_invariant_3_and_4_a_planner_that_dies_in_motion_stops_the_arm(caplog):
    bench = moving_bench(delay=0.02, look_ahead=0.3)
    bench.planner.die()
    bench.controller.planner_failed('was ended by SIGKILL')
    assert {code for _, code in bench.codes()} == {FAILURE}
    assert bench.error == 8001
    assert 'refused (8001): the motion planner: was ended by SIGKILL' in caplog.text
    trace = bench.run(most=1.0)
    assert_within_limits(trace)
    bench.send(point(0, HERE))
    assert bench.codes() == [(0, FAILURE)]
    assert 'starts again' in caplog.text
    bench.planner.ready = True
    bench.step(2.0)
    assert bench.joints.tolist() == trace[-1].tolist()
    bench.send(point(50, HERE))
    assert bench.codes() == [(50, FAILURE)]
    bench.send(point(0, HERE))
    bench.rest()
    assert bench.codes() == [(0, SUCCESS)]
    assert bench.joints.tolist() == list(HERE)
    assert bench.error == 0
    assert bench.controller.timing.planner_failures == 1


def test_a_planner_that_dies_while_the_arm_rests():
    bench = smooth_bench()
    bench.planner.die()
    bench.controller.planner_failed('ended with exit code 1')
    assert not bench.controller.moving
    assert bench.error == 8001
    assert bench.controller.status().motion_possible == 0
    bench.send(point(0, (0.1,)))
    assert bench.codes() == [(0, FAILURE)]
    bench.planner.ready = True
    bench.do('reset')
    assert bench.error == 0
    bench.send(point(0, (0.1,)))
    bench.rest()
    assert bench.codes() == [(0, SUCCESS)]


def test_with_the_motors_off_it_is_the_motors_that_are_told():
    bench = Bench(motors=False, planner=InlinePlanner())
    bench.planner.ready = False
    bench.send(point(0, (0.1,)))
    assert bench.error == 4031


def test_a_planner_that_finds_nothing_is_a_failure_after_some_attempts():
    bench = smooth_bench()
    bench.planner.plan = lambda request, limits: None
    bench.send(*stream(way(10)))
    bench.rest(most=1.0)
    assert bench.planner.asked == ATTEMPTS
    assert bench.error == 8001
    assert bench.joints.tolist() == list(HERE)


def test_a_planner_that_finds_nothing_in_motion_lets_the_plan_so_far_end():
    bench = moving_bench(count=400)
    bench.planner.plan = lambda request, limits: None
    trace = bench.run()
    assert_within_limits(trace)
    assert bench.error == 8001  # at rest then, before the last point
    assert bench.joints[0] < 0.39


# ---- time


def test_the_same_calls_give_the_same_motion():
    traces = []
    for _ in range(2):
        bench = smooth_bench(0.012)
        bench.send(*stream(way(60)))
        traces.append(bench.run())
    assert np.array_equal(*traces)


def test_a_long_step_ends_at_rest_on_the_plan_and_goes_on():
    bench = moving_bench(count=200, look_ahead=0.6)
    before = bench.joints
    bench.controller.step(30.0)  # the machine was away
    assert np.all(np.abs(bench.joints - before) < 0.4)
    bench.rest()
    assert bench.joints.tolist() == way(200)[-1].tolist()
    assert bench.codes()[-1] == (199, SUCCESS)


def test_time_that_passes_at_rest_does_not_count():
    bench = smooth_bench()
    bench.send(point(0))
    bench.controller.step(3600.0)
    bench.send(*stream(way(40))[1:])
    assert 0.7 < bench.rest() < 1.1
