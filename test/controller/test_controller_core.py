# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motors, E-stop, lost clients and state of the core, on a manual clock."""

import struct
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
    Peer,
    point,
)

from epson_driver.controller.core import Controller
from epson_driver.controller.faults.fault_text import parse
from epson_driver.controller.states import EStop, Motors, Power, RefusedError, Tasks
from epson_driver.controllers.profile import load_controller_profile
from epson_driver.simple_message import FrameError

HERE = (0.0,) * 6
THERE = (0.5, -0.4, 0.3, 0.2, -0.1, 1.0)


def moving_bench(*more):
    bench = Bench()
    bench.send(point(0, THERE), *more)
    bench.step(0.1)
    assert bench.controller.in_motion
    assert bench.codes() == []
    return bench


def assert_stays(bench, seconds=1.0):
    stood = bench.joints.tolist()
    bench.step(seconds)
    assert bench.joints.tolist() == stood
    assert not bench.controller.in_motion


def test_it_boots_with_the_motors_off_where_it_was_told_to_stand():
    bench = Bench(start=THERE, motors=False, connect=False)
    status = bench.controller.status()
    assert (status.drives_powered, status.e_stopped, status.error_code, status.in_error) == (
        (0, 0, 0, 0)
    )
    assert (status.in_motion, status.mode, status.motion_possible) == (0, 2, 0)
    assert bench.controller.joint_position().joints == (*THERE, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize('start', [(9.0,) + (0.0,) * 5, (np.nan,) * 6, (0.0,) * 5])
def test_a_start_that_cannot_be_is_refused(start):
    with pytest.raises(ValueError, match=r'joint_1|target|start|5 joints'):
        Controller(MODEL, PROFILE, np.array(start))


def test_status_while_it_moves_and_after():
    bench = moving_bench()
    status = bench.controller.status()
    assert (status.drives_powered, status.in_motion, status.motion_possible) == (1, 1, 1)
    bench.rest()
    status = bench.controller.status()
    assert (status.drives_powered, status.in_motion, status.motion_possible) == (1, 0, 1)


@pytest.mark.invariant(3)
def test_invariant_3_motors_off_in_mid_move_brakes_first():
    bench = moving_bench(point(1, HERE))
    bench.do('motors off')
    assert bench.codes() == [(0, FAILURE), (1, FAILURE)]
    assert bench.controller.condition.motors is Motors.BRAKING
    assert bench.controller.status().drives_powered == 1
    bench.send(point(0, HERE))
    assert bench.codes() == [(0, FAILURE)]
    assert bench.error == 4031
    with pytest.raises(RefusedError, match='still brakes'):
        bench.do('motors on')
    assert bench.rest() < 0.2
    assert bench.condition.motors is Motors.OFF
    assert bench.controller.status().drives_powered == 0
    assert_stays(bench)


@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    'how', ['end of stream', 'garbage', 'other byte order', 'negative length']
)
def test_invariant_4_a_lost_client_stops_the_arm_and_takes_the_motors_off(how):
    bench = moving_bench(point(1, HERE))
    garbage = {
        'garbage': b'GET / HTTP/1.0\r\n\r\n',
        'other byte order': point(2, HERE, order='>'),
        'negative length': struct.pack('<i', -1),
    }
    if how == 'end of stream':
        bench.disconnect()
    else:
        with pytest.raises(FrameError):
            bench.send(garbage[how])
        assert bench.error == 8000
    assert bench.codes() == [(0, FAILURE), (1, FAILURE)]
    assert bench.controller.status().in_motion == 1
    bench.disconnect()  # twice is no error
    assert bench.rest() < 0.2
    assert bench.condition.motors is Motors.OFF
    bench.connect()  # however quickly it returns
    assert_stays(bench)
    bench.send(point(0, HERE))
    assert bench.codes() == [(0, FAILURE)]
    bench.do('motors on')
    bench.send(point(1, HERE))  # a new client begins with 0
    assert bench.codes() == [(1, FAILURE)]
    bench.send(point(0, HERE))
    bench.rest()
    assert bench.codes() == [(0, SUCCESS)]


def test_a_client_that_returns_while_the_arm_brakes_changes_nothing():
    bench = moving_bench()
    bench.disconnect()
    bench.connect()
    bench.codes()
    bench.send(point(0, HERE), point(STOP))
    assert bench.codes() == [(0, FAILURE), (STOP, SUCCESS)]
    bench.rest()
    assert bench.condition.motors is Motors.OFF
    assert_stays(bench)


def test_half_a_frame_of_the_old_client_is_not_continued_by_the_new_one():
    bench = Bench()
    bench.send(point(0, THERE)[:40])
    bench.disconnect()
    bench.connect()
    bench.do('motors on')
    bench.send(point(0, HERE))
    assert bench.codes() == [(0, SUCCESS)]


def test_a_new_client_begins_with_0_also_while_the_arm_stood():
    bench = Bench()
    bench.send(point(0), point(1))
    bench.disconnect()
    bench.connect()
    bench.do('motors on')
    bench.codes()
    bench.send(point(2), point(0))
    assert bench.codes() == [(2, FAILURE), (0, SUCCESS)]


def test_only_one_client():
    bench = Bench()
    with pytest.raises(ConnectionRefusedError, match='client already'):
        bench.connect()
    assert len(bench.controller.faults._wires) == 1


@pytest.mark.invariant(3, 4)
def test_invariant_3_and_4_estop_in_mid_move_and_the_way_back():
    bench = moving_bench(point(1, HERE))
    controller = bench.controller
    bench.do('E-stop press')
    assert bench.codes() == [(0, FAILURE), (1, FAILURE)]
    status = controller.status()
    assert (status.e_stopped, status.drives_powered, status.motion_possible) == (1, 0, 0)
    assert (status.error_code, status.in_error, status.in_motion) == (2261, 1, 1)
    bench.do('E-stop release')
    with pytest.raises(RefusedError, match='still brakes'):
        bench.do('reset')
    assert bench.rest() < 0.2
    assert controller.status().in_motion == 0
    assert controller.status().e_stopped == 1  # latched
    bench.send(point(0, HERE))
    assert bench.codes() == [(0, FAILURE)]
    assert bench.error == 2261
    with pytest.raises(RefusedError, match='reset'):
        bench.do('motors on')
    bench.do('reset')
    assert controller.status().e_stopped == 0
    assert bench.error == 0
    assert controller.condition.motors is Motors.OFF  # a reset switches nothing on
    bench.send(point(0, HERE))
    assert bench.error == 4031
    bench.do('motors on')
    assert_stays(bench)
    bench.codes()
    bench.send(point(2, HERE))  # nothing of the old trajectory
    assert bench.codes() == [(2, FAILURE)]
    bench.send(point(0, HERE))
    bench.rest()
    assert bench.codes() == [(0, SUCCESS)]


def test_an_estop_hides_and_its_reset_clears_every_other_error():
    bench = Bench()
    bench.send(point(0, (9.0,)))
    assert bench.error == 4001
    bench.do('E-stop press')
    bench.send(point(5, HERE))
    assert bench.error == 2261
    bench.do('E-stop release')
    assert bench.error == 2261
    bench.do('reset')
    assert bench.error == 0


def test_estop_while_the_arm_brakes_for_motors_off():
    bench = moving_bench()
    bench.do('motors off')
    bench.step(0.02)
    bench.do('E-stop press')
    assert bench.controller.status().drives_powered == 0
    bench.rest()
    assert bench.controller.condition.estop is EStop.PRESSED


def test_a_lost_client_during_an_estop_leaves_the_estop():
    bench = moving_bench()
    bench.do('E-stop press')
    bench.disconnect()
    bench.rest()
    assert bench.controller.condition.estop is EStop.PRESSED


def test_the_same_calls_give_the_same_bytes():
    def run():
        bench = Bench()
        trace = bytearray()
        random = np.random.default_rng(7)
        for index in range(60):
            joints = random.uniform(LIMITS.position_min, LIMITS.position_max)
            sequence = int(random.choice([0, index % 5, STOP]))
            bench.send(point(sequence, joints, float(random.uniform(0.0, 1.0))))
            bench.step(float(random.uniform(0.0, 0.3)))
            trace += struct.pack('<10d', *bench.controller.joint_position().joints)
        return bench.peer.take(), bytes(trace)

    assert run() == run()


def test_the_length_of_the_steps_does_not_change_where_the_arm_ends():
    ends = []
    for dt in (0.001, 0.004, 0.0037, 0.5):
        bench = Bench()
        bench.send(point(0, THERE), point(1, HERE), point(2, THERE))
        bench.rest(dt)
        ends.append((bench.joints.tolist(), bench.codes()))
    assert all(end == ends[0] for end in ends)


def test_a_long_step_goes_through_all_points_that_wait():
    bench = Bench()
    bench.send(*(point(i, THERE if i % 2 else HERE) for i in range(6)))
    bench.controller.step(60.0)
    bench.step(0.004)
    assert bench.codes() == [(i, SUCCESS) for i in range(6)]
    assert not bench.controller.in_motion


@pytest.mark.invariant(4)
def test_invariant_4_a_client_that_is_hung_up_is_not_heard_any_more():
    bench = Bench(motors=True)
    bench.controller.lines.hang_up('motion')
    assert bench.peer.ended == 'aborted'
    assert bench.condition.motors is Motors.OFF
    bench.do('motors on')
    bench.send(point(0, THERE))  # what was still on its way
    bench.step(1.0)
    assert bench.joints.tolist() == [0.0] * 6
    bench.disconnect()
    assert bench.condition.motors is Motors.ON  # it was gone before that
    bench.connect()


def test_a_reboot_hangs_up_refuses_and_comes_back():
    bench = moving_bench()
    bench.controller.reboot(2.0)
    assert bench.peer.ended == 'aborted'
    bench.step(1.9)
    bench.controller.reboot(5.0)  # again, before it is up
    bench.step(4.9)
    with pytest.raises(ConnectionRefusedError, match='boots'):
        bench.connect()
    bench.step(0.2)
    bench.connect()
    bench.send(point(0, HERE))
    assert bench.codes()[-1:] == [(0, FAILURE)]
    assert bench.error == 4031


def test_door_and_button_are_still_as_they_are_after_a_reboot_and_a_reset():
    bench = Bench(connect=False)
    bench.do('door open', 'E-stop press')
    bench.controller.reboot(1.0)
    assert (bench.condition.estop, bench.condition.tasks) == (EStop.PRESSED, Tasks.ABORTED)
    bench.do('E-stop release', 'reset')
    assert bench.condition.tasks is Tasks.INTERRUPTED
    bench.do('door close', 'continue', 'motors on')
    assert bench.controller.status().motion_possible == 1


def test_no_motion_is_possible_without_a_planner():
    planner = InlinePlanner()
    bench = Bench(planner=planner)
    assert bench.controller.status().motion_possible == 1
    planner.ready = False
    assert bench.controller.status().motion_possible == 0
    bench.send(point(0, THERE))
    assert bench.error == 8001


def test_a_reset_waits_for_the_arm():
    bench = moving_bench()
    with pytest.raises(RefusedError, match='still moves'):
        bench.do('reset')


def silent_profile():
    return replace(PROFILE, server=replace(PROFILE.server, aborted='silent'))


def test_a_port_that_was_not_read_is_opened_anew():
    bench = Bench(profile=silent_profile())
    bench.do('E-stop press')
    bench.send(point(0, THERE)[:30])
    assert bench.peer.ended is None
    assert bench.codes() == []
    bench.do('E-stop release', 'reset')
    assert bench.peer.ended == 'aborted'
    bench.connect()
    bench.do('motors on')
    bench.send(point(0, HERE))
    assert bench.codes() == [(0, SUCCESS)]


def test_a_port_that_closes_while_its_task_is_aborted():
    closing = replace(PROFILE, server=replace(PROFILE.server, aborted='close'))
    bench = Bench(profile=closing)
    bench.do('E-stop press')
    assert bench.peer.ended == 'aborted'
    with pytest.raises(ConnectionRefusedError, match='does not run'):
        bench.connect()
    bench.controller.connect('state', Peer())
    bench.do('E-stop release', 'reset')
    bench.connect()


def test_a_program_that_does_not_reconnect_serves_nobody_until_it_is_started():
    thesis = load_controller_profile('thesis')
    bench = Bench(profile=thesis)
    bench.disconnect()
    with pytest.raises(ConnectionRefusedError, match='start it'):
        bench.connect()
    bench.do('start')
    bench.connect()
    state = Peer()
    bench.controller.connect('state', state)
    with pytest.raises(FrameError):
        bench.send(b'GET / HTTP/1.0\r\n\r\n')  # both servers end
    assert state.ended == 'aborted'
    for port in ('motion', 'state'):
        with pytest.raises(ConnectionRefusedError, match='start it'):
            bench.controller.connect(port, Peer())
    bench.do('start')
    bench.connect()


@pytest.mark.parametrize('smooth', [False, True])
def test_an_estop_at_a_point_comes_when_the_arm_goes_to_it(smooth):
    bench = Bench(planner=InlinePlanner() if smooth else None)
    bench.controller.faults.start(parse('estop_at_point 4'))
    bench.send(*(point(i, (0.1 * (i + 1),), 0.0, 0.2) for i in range(8)))
    bench.rest()
    assert bench.condition.estop is EStop.PRESSED
    assert 0.25 < bench.joints[0] < 0.41


def test_a_point_after_a_stop_does_not_stand_in_the_way_of_start():
    bench = Bench()
    bench.do('stop')
    bench.send(point(0, THERE))
    assert bench.codes() == [(0, FAILURE)]
    assert bench.error == 2261
    assert bench.remote('Start,0') == ['#Start,0']
    assert bench.error == 0
    bench.send(point(0, THERE))
    bench.rest()
    assert bench.codes() == [(0, SUCCESS)]


def test_after_the_door_the_arm_goes_on_at_its_power():
    bench = moving_bench()
    assert bench.condition.power is Power.HIGH
    bench.do('door open')
    assert bench.condition.power is Power.LOW
    bench.rest()
    bench.do('door close', 'continue')
    assert bench.condition.power is Power.HIGH
    bench.rest()
    assert bench.codes() == [(0, SUCCESS)]


def test_a_server_that_is_dead_does_not_run():
    bench = Bench(profile=load_controller_profile('thesis'))
    bench.controller.connect('state', Peer()).closed()
    assert bench.remote('Sim,tasks') == [
        '#Sim,1=motion server,Normal,runs;2=state server,NoEmgAbort,does not run;'
        '3=I/O server,Normal,runs'
    ]
