# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motors, E-stop, lost clients and state of the core, on a manual clock."""

import struct

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
    Peer,
    point,
)

from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.condition.states import EStop, Motors, Power, RejectedError, Tasks
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
    stood = harness.joints.tolist()
    harness.step(seconds)
    assert harness.joints.tolist() == stood
    assert not harness.controller.in_motion


def test_it_boots_with_the_motors_off_where_it_was_told_to_stand():
    harness = Harness(start=THERE, motors=False, connect=False)
    status = harness.controller.status()
    assert (status.drives_powered, status.e_stopped, status.error_code, status.in_error) == (
        (0, 0, 0, 0)
    )
    assert (status.in_motion, status.mode, status.motion_possible) == (0, 2, 0)
    assert harness.controller.joint_position().joints == (*THERE, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize('start', [(9.0,) + (0.0,) * 5, (np.nan,) * 6, (0.0,) * 5])
def test_a_start_that_cannot_be_is_refused(start):
    with pytest.raises(ValueError, match=r'joint_1|target|start|5 joints'):
        new_controller(MODEL, PROFILE, np.array(start))


def test_status_while_it_moves_and_after():
    harness = moving_harness()
    status = harness.controller.status()
    assert (status.drives_powered, status.in_motion, status.motion_possible) == (1, 1, 1)
    harness.rest()
    status = harness.controller.status()
    assert (status.drives_powered, status.in_motion, status.motion_possible) == (1, 0, 1)


@pytest.mark.invariant(3)
def test_invariant_3_motors_off_in_mid_move_brakes_first():
    harness = moving_harness(point(1, HERE))
    harness.do('motors off')
    assert harness.codes() == [(0, FAILURE), (1, FAILURE)]
    assert harness.controller.condition.motors is Motors.BRAKING
    assert harness.controller.status().drives_powered == 1
    harness.send(point(0, HERE))
    assert harness.codes() == [(0, FAILURE)]
    assert harness.error == 4031
    with pytest.raises(RejectedError, match='still brakes'):
        harness.do('motors on')
    assert harness.rest() < 0.2
    assert harness.condition.motors is Motors.OFF
    assert harness.controller.status().drives_powered == 0
    assert_stays(harness)


@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    'how', ['end of stream', 'garbage', 'other byte order', 'negative length']
)
def test_invariant_4_a_lost_client_stops_the_arm_and_takes_the_motors_off(how):
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
    harness.disconnect()  # twice is no error
    assert harness.rest() < 0.2
    assert harness.condition.motors is Motors.OFF
    harness.connect()  # however quickly it returns
    assert_stays(harness)
    harness.send(point(0, HERE))
    assert harness.codes() == [(0, FAILURE)]
    harness.do('motors on')
    harness.send(point(1, HERE))  # a new client begins with 0
    assert harness.codes() == [(1, FAILURE)]
    harness.send(point(0, HERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


def test_a_client_that_returns_while_the_arm_brakes_changes_nothing():
    harness = moving_harness()
    harness.disconnect()
    harness.connect()
    harness.codes()
    harness.send(point(0, HERE), point(STOP))
    assert harness.codes() == [(0, FAILURE), (STOP, SUCCESS)]
    harness.rest()
    assert harness.condition.motors is Motors.OFF
    assert_stays(harness)


def test_half_a_frame_of_the_old_client_is_not_continued_by_the_new_one():
    harness = Harness()
    harness.send(point(0, THERE)[:40])
    harness.disconnect()
    harness.connect()
    harness.do('motors on')
    harness.send(point(0, HERE))
    assert harness.codes() == [(0, SUCCESS)]


def test_a_new_client_begins_with_0_also_while_the_arm_stood():
    harness = Harness()
    harness.send(point(0), point(1))
    harness.disconnect()
    harness.connect()
    harness.do('motors on')
    harness.codes()
    harness.send(point(2), point(0))
    assert harness.codes() == [(2, FAILURE), (0, SUCCESS)]


def test_only_one_client():
    harness = Harness()
    with pytest.raises(ConnectionRefusedError, match='client already'):
        harness.connect()
    assert harness.controller.faults.attached == 1


@pytest.mark.invariant(3, 4)
def test_invariant_3_and_4_estop_in_mid_move_and_the_way_back():
    harness = moving_harness(point(1, HERE))
    controller = harness.controller
    harness.do('E-stop press')
    assert harness.codes() == [(0, FAILURE), (1, FAILURE)]
    status = controller.status()
    assert (status.e_stopped, status.drives_powered, status.motion_possible) == (1, 0, 0)
    assert (status.error_code, status.in_error, status.in_motion) == (2261, 1, 1)
    harness.do('E-stop release')
    with pytest.raises(RejectedError, match='still brakes'):
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
    assert controller.condition.motors is Motors.OFF  # a reset switches nothing on
    harness.send(point(0, HERE))
    assert harness.error == 4031
    harness.do('motors on')
    assert_stays(harness)
    harness.codes()
    harness.send(point(2, HERE))  # nothing of the old trajectory
    assert harness.codes() == [(2, FAILURE)]
    harness.send(point(0, HERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


def test_an_estop_hides_and_its_reset_clears_every_other_error():
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


def test_estop_while_the_arm_brakes_for_motors_off():
    harness = moving_harness()
    harness.do('motors off')
    harness.step(0.02)
    harness.do('E-stop press')
    assert harness.controller.status().drives_powered == 0
    harness.rest()
    assert harness.controller.condition.estop is EStop.PRESSED


def test_a_lost_client_during_an_estop_leaves_the_estop():
    harness = moving_harness()
    harness.do('E-stop press')
    harness.disconnect()
    harness.rest()
    assert harness.controller.condition.estop is EStop.PRESSED


def test_the_same_calls_give_the_same_bytes():
    def run():
        harness = Harness()
        trace = bytearray()
        random = np.random.default_rng(7)
        for index in range(60):
            joints = random.uniform(LIMITS.position_min, LIMITS.position_max)
            sequence = int(random.choice([0, index % 5, STOP]))
            harness.send(point(sequence, joints, float(random.uniform(0.0, 1.0))))
            harness.step(float(random.uniform(0.0, 0.3)))
            trace += struct.pack('<10d', *harness.controller.joint_position().joints)
        return harness.peer.take(), bytes(trace)

    assert run() == run()


def test_the_length_of_the_steps_does_not_change_where_the_arm_ends():
    ends = []
    for dt in (0.001, 0.004, 0.0037, 0.5):
        harness = Harness()
        harness.send(point(0, THERE), point(1, HERE), point(2, THERE))
        harness.rest(dt)
        ends.append((harness.joints.tolist(), harness.codes()))
    assert all(end == ends[0] for end in ends)


def test_a_long_step_goes_through_all_points_that_wait():
    harness = Harness()
    harness.send(*(point(i, THERE if i % 2 else HERE) for i in range(6)))
    harness.controller.step(60.0)
    harness.step(0.004)
    assert harness.codes() == [(i, SUCCESS) for i in range(6)]
    assert not harness.controller.in_motion


@pytest.mark.invariant(4)
def test_invariant_4_a_client_that_is_hung_up_is_not_heard_any_more():
    harness = Harness(motors=True)
    harness.controller.clients.hang_up('motion')
    assert harness.peer.ended == 'aborted'
    assert harness.condition.motors is Motors.OFF
    harness.do('motors on')
    harness.send(point(0, THERE))  # what was still on its way
    harness.step(1.0)
    assert harness.joints.tolist() == [0.0] * 6
    harness.disconnect()
    assert harness.condition.motors is Motors.ON  # it was gone before that
    harness.connect()


def test_a_reboot_hangs_up_refuses_and_comes_back():
    harness = moving_harness()
    harness.controller.reboot(2.0)
    assert harness.peer.ended == 'aborted'
    harness.step(1.9)
    harness.controller.reboot(5.0)  # again, before it is up
    harness.step(4.9)
    with pytest.raises(ConnectionRefusedError, match='boots'):
        harness.connect()
    harness.step(0.2)
    harness.connect()
    harness.send(point(0, HERE))
    assert harness.codes()[-1:] == [(0, FAILURE)]
    assert harness.error == 4031


def test_door_and_button_are_still_as_they_are_after_a_reboot_and_a_reset():
    harness = Harness(connect=False)
    harness.do('door open', 'E-stop press')
    harness.controller.reboot(1.0)
    assert (harness.condition.estop, harness.condition.tasks) == (EStop.PRESSED, Tasks.ABORTED)
    harness.do('E-stop release', 'reset')
    assert harness.condition.tasks is Tasks.INTERRUPTED
    harness.do('door close', 'continue', 'motors on')
    assert harness.controller.status().motion_possible == 1


def test_no_motion_is_possible_without_a_planner():
    planner = InlinePlanner()
    harness = Harness(planner=planner)
    assert harness.controller.status().motion_possible == 1
    planner.ready = False
    assert harness.controller.status().motion_possible == 0
    harness.send(point(0, THERE))
    assert harness.error == 8001


def test_a_reset_waits_for_the_arm():
    harness = moving_harness()
    with pytest.raises(RejectedError, match='still moves'):
        harness.do('reset')


@pytest.mark.parametrize('smooth', [False, True])
def test_an_estop_at_a_point_comes_when_the_arm_goes_to_it(smooth):
    harness = Harness(planner=InlinePlanner() if smooth else None)
    harness.controller.faults.start(parse('estop_at_point 4'))
    harness.send(*(point(i, (0.1 * (i + 1),), 0.0, 0.2) for i in range(8)))
    harness.rest()
    assert harness.condition.estop is EStop.PRESSED
    assert 0.25 < harness.joints[0] < 0.41


def test_a_point_after_a_stop_does_not_stand_in_the_way_of_start():
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


def test_after_the_door_the_arm_goes_on_at_its_power():
    harness = moving_harness()
    assert harness.condition.power is Power.HIGH
    harness.do('door open')
    assert harness.condition.power is Power.LOW
    harness.rest()
    harness.do('door close', 'continue')
    assert harness.condition.power is Power.HIGH
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


def test_a_client_of_a_port_that_controllers_have_not_is_not_served():
    controller = new_controller(MODEL, PROFILE)
    with pytest.raises(ValueError, match='teapot is no port'):
        controller.connect('teapot', Peer())
    controller.connect('remote', Peer())  # and nothing is kept of it
