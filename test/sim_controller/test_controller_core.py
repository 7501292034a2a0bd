# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motors, E-stop, lost clients and state of the controller core on a manual clock."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from support.controller_harness import (
    FAILURE,
    LIMITS,
    MODEL,
    PROFILE,
    SUCCESS,
    Harness,
    InlinePlanner,
    point,
)

from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.condition.states import EStop, Motors, Power, RejectedError
from epson_driver.sim_controller.faults.fault_kinds import parse
from epson_driver.simple_message import FrameError

HERE = (0.0,) * 6
THERE = (0.5, -0.4, 0.3, 0.2, -0.1, 1.0)


def moving_harness(*more):
    harness = Harness()
    harness.send(point(0, THERE), *more)
    harness.step(0.1)
    assert harness.controller.in_motion
    assert harness.codes() == []
    return harness


def assert_stays(harness, seconds=1.0):
    stopped = harness.joints.tolist()
    harness.step(seconds)
    assert harness.joints.tolist() == stopped
    assert not harness.controller.in_motion


def test_controller_boots_at_the_given_position_with_motors_off():
    harness = Harness(start=THERE, motors=False, connect=False)
    status = harness.controller.status()
    assert (status.drives_powered, status.e_stopped, status.error_code, status.in_error) == (
        (0, 0, 0, 0)
    )
    assert (status.in_motion, status.mode, status.motion_possible) == (0, 2, 0)
    assert harness.controller.joint_position().joints == (*THERE, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize('start', [(9.0,) + (0.0,) * 5, (np.nan,) * 6, (0.0,) * 5])
def test_invalid_start_position_is_refused(start):
    with pytest.raises(ValueError, match=r'joint_1|target|start|5 joints'):
        new_controller(MODEL, PROFILE, np.array(start))


@pytest.mark.invariant(3)
def test_inv3_motors_off_in_motion_brakes_first():
    harness = moving_harness(point(1, HERE))
    harness.do('motors off')
    assert harness.codes() == [(0, FAILURE), (1, FAILURE)]
    assert harness.controller.condition.motors is Motors.BRAKING
    assert harness.controller.status().drives_powered == 1
    harness.send(point(0, HERE))
    assert harness.codes() == [(0, FAILURE)]
    assert harness.error == 4031
    with pytest.raises(RejectedError, match='still braking'):
        harness.do('motors on')
    assert harness.rest() < 0.2
    assert harness.condition.motors is Motors.OFF
    assert harness.controller.status().drives_powered == 0
    assert_stays(harness)


@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    'how', ['end of stream', 'garbage', 'other byte order', 'negative length']
)
def test_inv4_lost_client_stops_the_arm_and_switches_motors_off(how):
    harness = moving_harness(point(1, HERE))
    garbage = {
        'garbage': b'GET / HTTP/1.0\r\n\r\n',
        'other byte order': point(2, HERE, order='>'),
        'negative length': struct.pack('<i', -1),
    }
    if how == 'end of stream':
        harness.disconnect()
    else:
        with pytest.raises(FrameError):
            harness.send(garbage[how])
        assert harness.error == 8000
    assert harness.codes() == [(0, FAILURE), (1, FAILURE)]
    assert harness.controller.status().in_motion == 1
    harness.disconnect()  # repeating it is no error
    assert harness.rest() < 0.2
    assert harness.condition.motors is Motors.OFF
    harness.connect()  # an immediate reconnection
    assert_stays(harness)
    harness.send(point(0, HERE))
    assert harness.codes() == [(0, FAILURE)]
    harness.do('motors on')
    harness.send(point(1, HERE))  # a new client starts with 0
    assert harness.codes() == [(1, FAILURE)]
    harness.send(point(0, HERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


def test_incomplete_frame_is_dropped_with_its_client():
    harness = Harness()
    harness.send(point(0, THERE)[:40])
    harness.disconnect()
    harness.connect()
    harness.do('motors on')
    harness.send(point(0, HERE))
    assert harness.codes() == [(0, SUCCESS)]


def test_second_motion_client_is_refused():
    harness = Harness()
    with pytest.raises(ConnectionRefusedError, match='another motion client'):
        harness.connect()


@pytest.mark.invariant(3, 4)
def test_inv3_and_4_estop_in_motion_stops_the_arm_until_enabled_again():
    harness = moving_harness(point(1, HERE))
    controller = harness.controller
    harness.do('E-stop press')
    assert harness.codes() == [(0, FAILURE), (1, FAILURE)]
    status = controller.status()
    assert (status.e_stopped, status.drives_powered, status.motion_possible) == (1, 0, 0)
    assert (status.error_code, status.in_error, status.in_motion) == (2261, 1, 1)
    harness.do('E-stop release')
    with pytest.raises(RejectedError, match='still braking'):
        harness.do('reset')
    assert harness.rest() < 0.2
    assert controller.status().in_motion == 0
    assert controller.status().e_stopped == 1  # latched
    harness.send(point(0, HERE))
    assert harness.codes() == [(0, FAILURE)]
    assert harness.error == 2261
    with pytest.raises(RejectedError, match='reset'):
        harness.do('motors on')
    harness.do('reset')
    assert controller.status().e_stopped == 0
    assert harness.error == 0
    assert controller.condition.motors is Motors.OFF  # reset does not switch motors on
    harness.send(point(0, HERE))
    assert harness.error == 4031
    harness.do('motors on')
    assert_stays(harness)
    harness.codes()
    harness.send(point(2, HERE))  # the old trajectory is over
    assert harness.codes() == [(2, FAILURE)]
    harness.send(point(0, HERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


def test_estop_hides_other_errors_and_its_reset_clears_them():
    harness = Harness()
    harness.send(point(0, (9.0,)))
    assert harness.error == 4001
    harness.do('E-stop press')
    harness.send(point(5, HERE))
    assert harness.error == 2261
    harness.do('E-stop release')
    assert harness.error == 2261
    harness.do('reset')
    assert harness.error == 0


def test_step_length_does_not_change_the_end_position():
    ends = []
    for dt in (0.001, 0.004, 0.0037, 0.5):
        harness = Harness()
        harness.send(point(0, THERE), point(1, HERE), point(2, THERE))
        harness.rest(dt)
        ends.append((harness.joints.tolist(), harness.codes()))
    assert all(end == ends[0] for end in ends)


@pytest.mark.invariant(4)
def test_inv4_points_of_a_disconnected_client_are_ignored():
    harness = Harness(motors=True)
    harness.controller.clients.hang_up('motion')
    assert harness.peer.ended == 'aborted'
    assert harness.condition.motors is Motors.OFF
    harness.do('motors on')
    harness.send(point(0, THERE))  # bytes still in transit
    harness.step(1.0)
    assert harness.joints.tolist() == [0.0] * 6
    harness.disconnect()
    assert harness.condition.motors is Motors.ON  # it was already disconnected
    harness.connect()


def test_reboot_disconnects_and_refuses_clients_until_it_ends():
    harness = moving_harness()
    harness.controller.reboot(2.0)
    assert harness.peer.ended == 'aborted'
    harness.step(1.9)
    harness.controller.reboot(5.0)  # again, before the first one ends
    harness.step(4.9)
    with pytest.raises(ConnectionRefusedError, match='boots'):
        harness.connect()
    harness.step(0.2)
    harness.connect()
    harness.send(point(0, HERE))
    assert harness.codes()[-1:] == [(0, FAILURE)]
    assert harness.error == 4031


@pytest.mark.parametrize('smooth', [False, True])
def test_estop_at_point_is_pressed_when_the_move_starts(smooth):
    harness = Harness(planner=InlinePlanner() if smooth else None)
    harness.controller.faults.start(parse('estop_at_point 4'))
    harness.send(*(point(i, (0.1 * (i + 1),), 0.0, 0.2) for i in range(8)))
    harness.rest()
    assert harness.condition.estop is EStop.PRESSED
    assert 0.25 < harness.joints[0] < 0.41


def test_refused_point_after_stop_does_not_prevent_start():
    harness = Harness()
    harness.do('stop')
    harness.send(point(0, THERE))
    assert harness.codes() == [(0, FAILURE)]
    assert harness.error == 2261
    assert harness.remote('Start,0') == ['#Start,0']
    assert harness.error == 0
    harness.send(point(0, THERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


def test_continue_after_the_door_restores_the_power():
    harness = moving_harness()
    assert harness.condition.power is Power.HIGH
    harness.do('door open')
    assert harness.condition.power is Power.LOW
    harness.rest()
    harness.do('door close', 'continue')
    assert harness.condition.power is Power.HIGH
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


@pytest.mark.invariant(2)
def test_inv2_profile_with_low_power_keeps_the_arm_slow():
    motion = replace(PROFILE.motion, power='low')
    harness = Harness(profile=replace(PROFILE, motion=motion), planner=InlinePlanner())
    harness.send(point(0, (0.1,) * 6))
    velocities = np.abs(np.diff(harness.run(), axis=0)) / 0.004
    assert np.all(velocities <= 0.05 * LIMITS.velocity * 1.001)
    assert 0.1 < np.max(velocities @ MODEL.reach) <= 0.25
