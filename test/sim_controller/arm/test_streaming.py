# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Smooth motion of the controller core, with an inline planner on a manual clock."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from support.controller_harness import (
    FAILURE,
    PROFILE,
    STOP,
    SUCCESS,
    Harness,
    InlinePlanner,
    assert_within_limits,
    point,
)
from support.streaming_harness import curve_points

from epson_driver.sim_controller.condition.states import Motors

DT = 0.004
HERE = (0.0,) * 6


def smooth_harness(delay=0.0, **settings):
    motion = replace(PROFILE.motion, **settings)
    return Harness(profile=replace(PROFILE, motion=motion), planner=InlinePlanner(delay))


def curve(count, amplitude=0.4):
    """Return points of a curve from rest at zero, rounded to float32, shape (count, 6), rad."""
    return curve_points(count, amplitude).astype(np.float32).astype(float)


def stream(points, period=0.02, first=0):
    durations = [0.001] + [period] * (len(points) - 1)
    return [
        point(first + index, joints, 0.0, duration)
        for index, (joints, duration) in enumerate(zip(points, durations, strict=True))
    ]


def nearest(trace, points):
    return max(np.min(np.max(np.abs(trace - item), axis=1)) for item in points)


def interior_stops(trace):
    """Count the steps without motion between the first and the last with some."""
    steps = np.max(np.abs(np.diff(trace, axis=0)), axis=1)
    moves = np.flatnonzero(steps > 1e-9)
    return int(np.sum(steps[moves[0] : moves[-1]] <= 1e-9))


# ---- points and flow control


def test_points_are_answered_immediately_within_the_look_ahead():
    harness = smooth_harness()
    points = curve(40)
    harness.send(*stream(points))
    assert harness.codes() == [(i, SUCCESS) for i in range(40)]
    assert harness.controller.status().in_motion == 1
    trace = harness.run()
    assert_within_limits(trace)
    assert harness.joints.tolist() == points[-1].tolist()
    assert harness.controller.status().in_motion == 0
    assert harness.error == 0


def test_arm_passes_all_points_in_time_without_a_stop():
    harness = smooth_harness()
    points = curve(80)
    harness.send(*stream(points))
    trace = harness.run()
    assert interior_stops(trace) == 0
    assert nearest(trace, points) < 0.01
    assert len(trace) * DT < 1.15 * 79 * 0.02 + 0.1


def test_replies_wait_for_look_ahead_in_order():
    harness = smooth_harness(look_ahead=0.5)
    points = curve(200)
    harness.send(*stream(points))
    answered = len(harness.codes())
    assert 26 <= answered <= 31  # half a second (the first points are close together)
    counts = []
    while harness.controller.moving:
        harness.step(0.1)
        codes = harness.codes()
        assert codes == [(answered + i, SUCCESS) for i in range(len(codes))]
        answered += len(codes)
        counts.append(len(codes))
    assert answered == 200
    assert max(counts) <= 0.1 / 0.02 * 1.2 + 1  # at the speed of the arm
    assert harness.joints.tolist() == points[-1].tolist()


def test_look_ahead_is_also_limited_in_points():
    harness = smooth_harness(look_ahead_points=10)
    harness.send(*stream(curve(60, amplitude=1.2)))
    assert len(harness.codes()) == 11  # point 0 is the current position
    harness.rest()
    assert harness.codes() == [(i, SUCCESS) for i in range(11, 60)]


def test_interrupted_stream_ends_at_rest_at_its_last_point():
    harness = smooth_harness()
    points = curve(80)
    harness.send(*stream(points)[:30])
    trace = harness.run()
    assert_within_limits(trace)
    assert harness.joints.tolist() == points[29].tolist()
    harness.send(*stream(points)[30:])
    harness.rest()
    assert harness.joints.tolist() == points[-1].tolist()
    assert harness.codes() == [(i, SUCCESS) for i in range(80)]


def test_sequence_0_starts_a_new_trajectory_after_a_rest():
    harness = smooth_harness()
    points = curve(20)
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
    """Return a harness in motion, with all points answered if the look-ahead allows."""
    harness = smooth_harness(delay, **settings)
    harness.send(*stream(curve(count)))
    harness.step(0.7)
    assert harness.controller.moving
    assert 0.0 < harness.joints[0] < 0.4
    harness.codes()
    return harness


@pytest.mark.invariant(3)
@pytest.mark.parametrize('delay', [0.0, 0.03])
def test_inv3_stop_discards_points_and_brakes_within_limits(delay):
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


@pytest.mark.invariant(3, 4)
def test_inv3_and_4_estop_in_motion_ends_the_trajectory():
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
def test_inv3_motors_off_and_lost_client_brake_first(how):
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


# ---- pauses and power


# ---- the planner


@pytest.mark.parametrize('delay', [0.008, 0.02, 0.06, 0.12])
def test_slow_planner_does_not_disturb_the_motion(delay):
    harness = smooth_harness(delay)
    points = curve(80)
    harness.send(*stream(points))
    trace = harness.run()
    assert_within_limits(trace)
    assert nearest(trace, points) < 0.01
    assert harness.joints.tolist() == points[-1].tolist()


def test_late_plans_are_counted_and_logged_once(caplog):
    caplog.set_level(logging.INFO)
    harness = smooth_harness(0.004)
    points = curve(150)
    harness.send(*stream(points))
    harness.step(0.3)
    harness.planner.delay = 0.1  # longer than the estimated latency
    harness.step(0.5)
    harness.planner.delay = 0.004
    trace = harness.run()
    assert_within_limits(trace)
    late = harness.controller.timing.late_plans
    assert late >= 1
    assert harness.joints.tolist() == points[-1].tolist()
    text = f'in this motion: {late} plan(s) too late and not used'
    assert caplog.text.count(text) == 1
    caplog.clear()
    harness.send(*stream(points[::-1]))
    harness.rest()
    assert 'in this motion' not in caplog.text
    assert harness.remote('Sim,timing') == [f'#Sim,0,{late},0,0']


@pytest.mark.invariant(3, 4)
def test_inv3_and_4_dead_planner_stops_a_moving_arm(caplog):
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
    assert 'is restarting' in caplog.text
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


def test_motors_off_takes_precedence_over_a_missing_planner():
    harness = Harness(motors=False, planner=InlinePlanner())
    harness.planner.ready = False
    harness.send(point(0, (0.1,)))
    assert harness.error == 4031


def test_failed_planning_in_motion_executes_the_current_plan():
    harness = moving_harness(count=400)
    harness.planner.plan = lambda request, limits: None
    trace = harness.run()
    assert_within_limits(trace)
    assert harness.error == 8001  # at rest before the last point
    assert harness.joints[0] < 0.39


# ---- time


@pytest.mark.slow
def test_long_step_ends_at_rest_on_the_plan():
    harness = moving_harness(count=200, look_ahead=0.6)
    before = harness.joints
    harness.controller.step(30.0)  # a scheduling delay
    assert np.all(np.abs(harness.joints - before) < 0.4)
    harness.rest()
    assert harness.joints.tolist() == curve(200)[-1].tolist()
    assert harness.codes()[-1] == (199, SUCCESS)
