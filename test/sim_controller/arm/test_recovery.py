# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Door, pause and push: the motion resumes from the interruption, on request only."""

import numpy as np
import pytest
from support.controller_harness import (
    FAILURE,
    LIMITS,
    SIMULATED,
    STOP,
    SUCCESS,
    Harness,
    InlinePlanner,
    point,
)

from epson_driver.sim_controller.arm.low_power import LOW_POWER
from epson_driver.sim_controller.condition.states import Motors, RejectedError, Tasks
from epson_driver.sim_controller.core import MAX_PUSH

DT = 0.004
POINTS = [(0.1 * i, -0.08 * i, 0.05 * i, 0.0, 0.1 * i, 0.0) for i in range(1, 9)]
LAST = np.array(POINTS[-1], dtype=np.float32)
LOW = LOW_POWER

both = pytest.mark.parametrize('smooth', [False, True], ids=['ptp', 'smooth'])


def new_moving_harness(smooth):
    harness = Harness(planner=InlinePlanner() if smooth else None)
    harness.send(*(point(i, joints, 0.0, 0.2) for i, joints in enumerate(POINTS)))
    harness.step(0.6)
    assert harness.controller.in_motion
    return harness


def speeds(harness, seconds):
    """Return the largest fraction of the maximum joint speed in each cycle."""
    path = [harness.joints]
    for _ in range(round(seconds / DT)):
        harness.step(DT)
        path.append(harness.joints)
    return np.max(np.abs(np.diff(path, axis=0)) / DT / LIMITS.velocity, axis=1)


def assert_arrives(harness):
    harness.rest()
    codes = harness.codes()
    assert codes == [(i, SUCCESS) for i in range(len(POINTS))][-len(codes) :]
    assert codes or harness.planner
    assert np.allclose(harness.joints, LAST, atol=1e-6)


@both
@pytest.mark.parametrize('push', [0.0, 0.2])
def test_continue_after_the_door_returns_slowly_to_the_path(smooth, push):
    harness = new_moving_harness(smooth)
    harness.do('door open')
    assert harness.controller.status().motion_possible == 0
    harness.rest()
    assert harness.condition.motors is Motors.HELD
    assert harness.controller.status().drives_powered == 0
    interrupted = harness.joints
    assert not np.allclose(interrupted, LAST, atol=0.05)
    if push:
        harness.controller.disturb(1, -push)
        assert np.allclose(interrupted - harness.joints, [0, push, 0, 0, 0, 0])
    stood = harness.joints
    assert np.all(speeds(harness, 1.0) == 0.0)
    with pytest.raises(RejectedError, match='close it'):
        harness.do('continue')
    harness.do('door close')
    assert np.all(speeds(harness, 1.0) == 0.0), 'a closed door alone moves nothing'
    assert np.array_equal(harness.joints, stood)
    harness.do('continue')
    if push:
        assert harness.condition.tasks is Tasks.RECOVERING
        while harness.condition.tasks is Tasks.RECOVERING:
            assert speeds(harness, DT).max() <= LOW * (1.0 + 1e-6)
        assert np.allclose(harness.joints, interrupted, atol=1e-6)
    assert_arrives(harness)
    assert harness.condition.tasks is Tasks.RUNNING


@both
def test_paused_motion_arrives_after_continue(smooth):
    harness = new_moving_harness(smooth)
    harness.do('pause')
    harness.rest()
    status = harness.controller.status()
    assert (status.drives_powered, status.in_motion, status.motion_possible) == (1, 0, 0)
    assert np.all(speeds(harness, 1.0) == 0.0)
    harness.do('continue')
    assert_arrives(harness)


@both
@pytest.mark.parametrize('event', ['pause', 'door open'])
def test_stop_during_a_pause_ends_the_trajectory(smooth, event):
    harness = new_moving_harness(smooth)
    harness.do(event)
    harness.rest()
    harness.codes()
    harness.send(point(STOP))
    assert harness.codes()[-1] == (STOP, SUCCESS)
    assert not harness.controller.moving
    if event == 'door open':
        harness.do('door close')
    harness.do('continue')
    assert np.all(speeds(harness, 1.0) == 0.0)
    assert harness.condition.tasks is Tasks.RUNNING
    harness.send(point(0, POINTS[0]))
    harness.rest()
    assert np.allclose(harness.joints, np.float32(POINTS[0]), atol=1e-6)


@both
@pytest.mark.parametrize('event', ['E-stop press', 'stop', 'motors off', 'error'])
def test_interrupted_motion_that_was_ended_never_resumes(smooth, event):
    harness = new_moving_harness(smooth)
    harness.do('door open')
    harness.rest()
    harness.controller.disturb(0, 0.1)
    harness.do(event)
    assert not harness.controller.moving
    harness.do('E-stop release', 'door close')
    for event in ('reset', 'start', 'continue', 'motors on'):
        try:
            harness.do(event)
        except RejectedError:
            continue
        assert np.all(speeds(harness, 0.3) == 0.0), event
    assert harness.condition.motors is Motors.ON
    harness.codes()
    harness.send(point(3, POINTS[3]))  # the old trajectory is discarded
    assert harness.codes() == [(3, FAILURE)]
    harness.send(point(0, POINTS[0]))  # starts at the pushed position
    assert speeds(harness, 0.5).max() < 1.0
    harness.rest()
    assert np.allclose(harness.joints, np.float32(POINTS[0]), atol=1e-6)


@both
def test_door_opened_during_the_return_interrupts_it_again(smooth):
    harness = new_moving_harness(smooth)
    harness.do('door open')
    harness.rest()
    harness.controller.disturb(0, 0.3)
    harness.do('door close', 'continue')
    harness.step(0.4)
    assert harness.condition.tasks is Tasks.RECOVERING
    harness.do('door open')
    assert harness.controller.in_motion  # it brakes
    harness.rest()
    assert harness.condition.motors is Motors.HELD
    harness.controller.disturb(0, -0.05)
    harness.do('door close', 'continue')
    assert_arrives(harness)


def waiting_to_continue(smooth, push=0.3):
    harness = new_moving_harness(smooth)
    harness.do('door open')
    harness.rest()
    harness.controller.disturb(0, push)
    harness.do('door close')
    harness.codes()
    return harness


@pytest.mark.invariant(2)
@both
@pytest.mark.parametrize('end', ['STOP', 'bad point'])
def test_inv2_arm_does_not_jump_after_a_waiting_motion_was_ended(smooth, end):
    harness = waiting_to_continue(smooth)
    harness.send(point(STOP) if end == 'STOP' else point(3, (9.0,)))
    harness.do('continue')
    assert speeds(harness, 0.1).max() == 0.0
    harness.send(point(0, POINTS[0]))
    assert speeds(harness, 2.0).max() <= 1.0
    assert np.allclose(harness.joints, np.float32(POINTS[0]), atol=1e-6)


@pytest.mark.invariant(2)
@both
@pytest.mark.parametrize('end', ['motors off', 'motion client lost', 'mode manual', 'stop'])
def test_inv2_arm_does_not_jump_after_an_interrupted_return_to_its_path(smooth, end):
    harness = waiting_to_continue(smooth)
    harness.do('continue')
    harness.step(0.3)
    assert harness.condition.tasks is Tasks.RECOVERING
    harness.do(end)
    assert speeds(harness, 1.0).max() <= LOW * (1.0 + 1e-6)
    assert harness.condition.tasks in (Tasks.RUNNING, Tasks.STOPPED)
    harness.do('mode auto', 'start', 'motors on')
    harness.send(point(0, POINTS[0]))
    assert speeds(harness, 2.0).max() <= 1.0
    assert np.allclose(harness.joints, np.float32(POINTS[0]), atol=1e-6)


@pytest.mark.invariant(3)
@both
def test_inv3_stop_ends_the_return_to_the_path(smooth):
    harness = waiting_to_continue(smooth)
    harness.do('continue')
    harness.step(0.4)
    harness.send(point(STOP))
    before = harness.joints
    harness.step(0.2)
    assert not harness.controller.in_motion
    assert np.abs(harness.joints - before).max() < 0.05
    assert harness.condition.tasks is Tasks.RUNNING


@both
def test_lost_client_before_the_return_leaves_the_arm_usable(smooth):
    harness = waiting_to_continue(smooth, push=0.0)
    harness.do('continue')
    harness.disconnect()
    harness.step(1.0)
    assert harness.condition.tasks is Tasks.RUNNING
    harness.connect()
    harness.do('motors on')
    harness.send(point(0, POINTS[0]))
    harness.rest()
    assert np.allclose(harness.joints, np.float32(POINTS[0]), atol=1e-6)


@both
def test_power_low_slows_a_moving_arm(smooth):
    harness = new_moving_harness(smooth)
    assert speeds(harness, 0.1).max() > LOW
    harness.do('power low')
    braking = speeds(harness, 0.4)
    assert np.all(np.diff(braking) < 0.02), 'braking'
    assert speeds(harness, 2.0).max() <= LOW * (1.0 + 1e-6)
    assert harness.controller.in_motion
    assert_arrives(harness)


def test_hard_push_of_a_powered_arm_is_a_servo_error():
    harness = Harness(profile=SIMULATED)
    harness.controller.disturb(2, 0.9 * MAX_PUSH['rad'])
    assert harness.controller.in_motion
    assert harness.joints[2] == pytest.approx(0.9 * MAX_PUSH['rad'], abs=1e-6)
    harness.rest()
    assert harness.joints[2] == 0.0
    assert harness.error == 0
    harness.controller.disturb(2, 1.1 * MAX_PUSH['rad'])
    assert harness.error == 5042
    assert harness.condition.motors is Motors.OFF
