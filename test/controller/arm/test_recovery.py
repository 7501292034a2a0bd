# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Door, pause and push: the arm goes on where it was interrupted, and only when it is told to."""

import numpy as np
import pytest
from controller_bench import (
    FAILURE,
    LIMITS,
    MODEL,
    PROFILE,
    RC620,
    STOP,
    SUCCESS,
    Bench,
    InlinePlanner,
    point,
)

from epson_driver.controller.core import SMALL_PUSH
from epson_driver.controller.states import Motors, RefusedError, Tasks

DT = 0.004
POINTS = [(0.1 * i, -0.08 * i, 0.05 * i, 0.0, 0.1 * i, 0.0) for i in range(1, 9)]
LAST = np.array(POINTS[-1], dtype=np.float32)
LOW = PROFILE.motion.low_power

both = pytest.mark.parametrize('smooth', [False, True], ids=['ptp', 'smooth'])


def on_its_way(smooth):
    bench = Bench(planner=InlinePlanner() if smooth else None)
    bench.send(*(point(i, joints, 0.0, 0.2) for i, joints in enumerate(POINTS)))
    bench.step(0.6)
    assert bench.controller.in_motion
    return bench


def speeds(bench, seconds):
    """Step; return the largest share of its speed that any joint had, cycle by cycle."""
    path = [bench.joints]
    for _ in range(round(seconds / DT)):
        bench.step(DT)
        path.append(bench.joints)
    return np.max(np.abs(np.diff(path, axis=0)) / DT / LIMITS.velocity, axis=1)


def assert_arrives(bench):
    bench.rest()
    codes = bench.codes()
    assert codes == [(i, SUCCESS) for i in range(len(POINTS))][-len(codes) :]
    assert codes or bench.planner
    assert np.allclose(bench.joints, LAST, atol=1e-6)


@both
@pytest.mark.parametrize('push', [0.0, 0.2])
def test_the_door_interrupts_and_continue_goes_on_slowly_at_first(smooth, push):
    bench = on_its_way(smooth)
    bench.do('door open')
    assert bench.controller.status().motion_possible == 0
    bench.rest()
    assert bench.condition.motors is Motors.HELD
    assert bench.controller.status().drives_powered == 0
    interrupted = bench.joints
    assert not np.allclose(interrupted, LAST, atol=0.05)
    if push:
        bench.controller.disturb(1, -push)
        assert np.allclose(interrupted - bench.joints, [0, push, 0, 0, 0, 0])
    stood = bench.joints
    assert np.all(speeds(bench, 1.0) == 0.0)
    with pytest.raises(RefusedError, match='close it'):
        bench.do('continue')
    bench.do('door close')
    assert np.all(speeds(bench, 1.0) == 0.0), 'a closed door alone moves nothing'
    assert np.array_equal(bench.joints, stood)
    bench.do('continue')
    if push:
        assert bench.condition.tasks is Tasks.RECOVERING
        while bench.condition.tasks is Tasks.RECOVERING:
            assert speeds(bench, DT).max() <= LOW * (1.0 + 1e-6)
        assert np.allclose(bench.joints, interrupted, atol=1e-6)
    assert_arrives(bench)
    assert bench.condition.tasks is Tasks.RUNNING


@both
def test_pause_and_continue(smooth):
    bench = on_its_way(smooth)
    bench.do('pause')
    bench.rest()
    status = bench.controller.status()
    assert (status.drives_powered, status.in_motion, status.motion_possible) == (1, 0, 0)
    assert np.all(speeds(bench, 1.0) == 0.0)
    bench.do('continue')
    assert_arrives(bench)


@both
@pytest.mark.parametrize('event', ['pause', 'door open'])
def test_a_stop_is_obeyed_in_a_pause_and_continue_moves_nothing_then(smooth, event):
    bench = on_its_way(smooth)
    bench.do(event)
    bench.rest()
    bench.codes()
    bench.send(point(STOP))
    assert bench.codes()[-1] == (STOP, SUCCESS)
    assert not bench.controller.moving
    if event == 'door open':
        bench.do('door close')
    bench.do('continue')
    assert np.all(speeds(bench, 1.0) == 0.0)
    assert bench.condition.tasks is Tasks.RUNNING
    bench.send(point(0, POINTS[0]))
    bench.rest()
    assert np.allclose(bench.joints, np.float32(POINTS[0]), atol=1e-6)


@both
@pytest.mark.parametrize('event', ['E-stop press', 'stop', 'motors off', 'error'])
def test_what_ends_an_interrupted_motion_ends_it_for_good(smooth, event):
    bench = on_its_way(smooth)
    bench.do('door open')
    bench.rest()
    bench.controller.disturb(0, 0.1)
    bench.do(event)
    assert not bench.controller.moving
    bench.do('E-stop release', 'door close')
    for way_back in ('reset', 'start', 'continue', 'motors on'):
        try:
            bench.do(way_back)
        except RefusedError:
            continue
        assert np.all(speeds(bench, 0.3) == 0.0), way_back
    assert bench.condition.motors is Motors.ON
    bench.codes()
    bench.send(point(3, POINTS[3]))  # nothing of the old trajectory
    assert bench.codes() == [(3, FAILURE)]
    bench.send(point(0, POINTS[0]))  # from where it was pushed to
    assert speeds(bench, 0.5).max() < 1.0
    bench.rest()
    assert np.allclose(bench.joints, np.float32(POINTS[0]), atol=1e-6)


@both
def test_the_door_opens_again_on_the_way_back(smooth):
    bench = on_its_way(smooth)
    bench.do('door open')
    bench.rest()
    bench.controller.disturb(0, 0.3)
    bench.do('door close', 'continue')
    bench.step(0.4)
    assert bench.condition.tasks is Tasks.RECOVERING
    bench.do('door open')
    assert bench.controller.in_motion  # it brakes
    bench.rest()
    assert bench.condition.motors is Motors.HELD
    bench.controller.disturb(0, -0.05)
    bench.do('door close', 'continue')
    assert_arrives(bench)


def jumps(bench, seconds):
    """Step; return the longest way that any joint went in one cycle, as a share of what it may."""
    return speeds(bench, seconds).max()


def waiting_to_continue(smooth, push=0.3):
    bench = on_its_way(smooth)
    bench.do('door open')
    bench.rest()
    bench.controller.disturb(0, push)
    bench.do('door close')
    bench.codes()
    return bench


@pytest.mark.invariant(2)
@both
@pytest.mark.parametrize('end', ['STOP', 'bad point'])
def test_invariant_2_no_jump_when_the_motion_was_ended_while_it_waited(smooth, end):
    bench = waiting_to_continue(smooth)
    bench.send(point(STOP) if end == 'STOP' else point(3, (9.0,)))
    bench.do('continue')
    assert jumps(bench, 0.1) == 0.0
    bench.send(point(0, POINTS[0]))
    assert jumps(bench, 2.0) <= 1.0
    assert np.allclose(bench.joints, np.float32(POINTS[0]), atol=1e-6)


@pytest.mark.invariant(2)
@both
@pytest.mark.parametrize('end', ['motors off', 'motion client lost', 'mode manual', 'stop'])
def test_invariant_2_no_jump_after_a_way_back_that_was_ended(smooth, end):
    bench = waiting_to_continue(smooth)
    bench.do('continue')
    bench.step(0.3)
    assert bench.condition.tasks is Tasks.RECOVERING
    bench.do(end)
    assert jumps(bench, 1.0) <= LOW * (1.0 + 1e-6)
    assert bench.condition.tasks in (Tasks.RUNNING, Tasks.STOPPED)
    bench.do('mode auto', 'start', 'motors on')
    bench.send(point(0, POINTS[0]))
    assert jumps(bench, 2.0) <= 1.0
    assert np.allclose(bench.joints, np.float32(POINTS[0]), atol=1e-6)


@pytest.mark.invariant(3)
@both
def test_invariant_3_a_stop_ends_the_way_back(smooth):
    bench = waiting_to_continue(smooth)
    bench.do('continue')
    bench.step(0.4)
    bench.send(point(STOP))
    before = bench.joints
    bench.step(0.2)
    assert not bench.controller.in_motion
    assert np.abs(bench.joints - before).max() < 0.05
    assert bench.condition.tasks is Tasks.RUNNING


@both
def test_a_way_back_that_ends_before_it_began_leaves_nothing_stuck(smooth):
    bench = waiting_to_continue(smooth, push=0.0)
    bench.do('continue')
    bench.disconnect()
    bench.step(1.0)
    assert bench.condition.tasks is Tasks.RUNNING
    bench.connect()
    bench.do('motors on')
    bench.send(point(0, POINTS[0]))
    bench.rest()
    assert np.allclose(bench.joints, np.float32(POINTS[0]), atol=1e-6)


def test_the_way_back_keeps_the_tool_speed_of_low_power():
    bench = waiting_to_continue(smooth=False, push=-1.0)
    bench.do('continue')
    path = [bench.joints]
    while bench.condition.tasks is Tasks.RECOVERING:
        bench.step(DT)
        path.append(bench.joints)
    tool = np.abs(np.diff(path, axis=0)) / DT @ MODEL.reach
    assert 0.2 < tool.max() <= PROFILE.motion.low_power_tool_speed * (1.0 + 1e-6)


@both
def test_power_low_slows_an_arm_that_moves(smooth):
    bench = on_its_way(smooth)
    assert speeds(bench, 0.1).max() > LOW
    bench.do('power low')
    braking = speeds(bench, 0.4)
    assert np.all(np.diff(braking) < 0.02), 'it brakes'
    assert speeds(bench, 2.0).max() <= LOW * (1.0 + 1e-6)
    assert bench.controller.in_motion
    assert_arrives(bench)


@both
@pytest.mark.parametrize('event', ['pause', 'STOP'])
def test_power_low_and_then_something_else(smooth, event):
    bench = on_its_way(smooth)
    bench.do('power low')
    bench.step(0.02)
    if event == 'pause':
        bench.do('pause')
        bench.rest()
        assert np.all(speeds(bench, 1.0) == 0.0)
        bench.do('continue')
        assert_arrives(bench)
    else:
        bench.send(point(STOP))
        bench.rest()
        bench.send(point(0, POINTS[0]))
        assert speeds(bench, 0.5).max() <= LOW * (1.0 + 1e-6)


def test_points_that_come_in_a_pause_wait_for_continue():
    bench = Bench()
    bench.do('pause')
    bench.send(point(0, POINTS[0]), point(1, POINTS[1]))
    assert np.all(speeds(bench, 1.0) == 0.0)
    assert bench.codes() == []
    bench.do('continue')
    bench.rest()
    assert bench.codes() == [(0, SUCCESS), (1, SUCCESS)]


def test_a_push_with_power_is_pushed_back_and_a_hard_one_is_a_servo_error():
    bench = Bench(profile=RC620)
    bench.controller.disturb(2, 0.9 * SMALL_PUSH['rad'])
    assert bench.controller.in_motion
    assert bench.joints[2] == pytest.approx(0.9 * SMALL_PUSH['rad'], abs=1e-6)
    bench.rest()
    assert bench.joints[2] == 0.0
    assert bench.error == 0
    bench.controller.disturb(2, 1.1 * SMALL_PUSH['rad'])
    assert bench.error == 5042
    assert bench.condition.motors is Motors.OFF


def test_pushes_with_power_add_up_to_an_error():
    bench = Bench(profile=RC620)
    for _ in range(2):
        bench.controller.disturb(2, 0.9 * SMALL_PUSH['rad'])
    assert bench.error == 5042


def test_a_push_beside_a_frozen_encoder_moves_only_the_joint_that_is_pushed():
    bench = Bench(start=(0.5, 0.0, 0.0, 0.0, 0.0, 0.0), motors=False)
    bench.controller.freeze(0)
    bench.do('motors on')
    bench.send(point(0, (0.8,)))
    bench.rest()
    bench.do('motors off')
    bench.controller.disturb(1, 0.01)
    assert bench.joints[0] == 0.5
    assert bench.controller.servo.actual[0] == pytest.approx(0.8)


def test_a_push_beyond_the_limits_is_refused_with_joint_value_and_limits():
    bench = Bench(motors=False)
    with pytest.raises(RefusedError, match=r'joint_2 = 3 rad is outside the limits -2\.79'):
        bench.controller.disturb(1, 3.0)
    assert np.all(bench.joints == 0.0)
