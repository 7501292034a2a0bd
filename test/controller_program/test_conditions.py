# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""E-stop, door, errors, lost clients, starts: nothing moves until it is enabled again."""

import math

import numpy as np
import pytest
from support.controller_harness import STOP, point
from support.spel_program_harness import OUR_FILES, OurProgramHarness

from epson_driver.sim_controller.spel_host.robot_values import VALUES, WORDS
from epson_driver.simple_message import IoSetting, IoType, Ping, ReplyCode, reply, request
from epson_driver.simple_message.io_messages import IoWrite
from epson_driver.spel import SpelError, TaskType

OK, FAILURE = 1, 2
SERVERS = ['MotionServer', 'StateServer', 'IoServer']


def line(harness, count, step=20.0, duration=1.0):
    """Return points along a line of joint 1, `step` degrees each, from where the arm is."""
    ways = np.outer(np.arange(1, count + 1), [math.radians(step), 0, 0, 0, 0, 0])
    points = (harness.position + ways).tolist()
    return [point(number, joints, 0.0, duration) for number, joints in enumerate(points)]


def moving(harness):
    """Return a client whose trajectory of six points is at its first one."""
    client = harness.ready()
    assert client.stream(*line(harness, 6)) == [(n, OK) for n in range(6)]
    harness.step(0.6)
    assert harness.controller.in_motion
    return client


def enable(harness):
    """Release the E-stop, reset, switch motors on, and start main."""
    harness.do('E-stop release', 'reset', 'motors on', 'start')


def assert_still(harness, seconds=3.0):
    """Assert that the arm comes to rest immediately, and does not move then."""
    harness.step(0.4)
    where = harness.position
    harness.step(seconds)
    assert np.array_equal(harness.position, where)


def assert_works(harness, client):
    """Assert that only a new trajectory is executed."""
    client.raw()
    assert client.stream(point(6, harness.position)) == [(6, FAILURE)]
    end = harness.position[0] - math.radians(15.0)
    assert client.stream(*line(harness, 3, -5.0, 0.3)) == [(n, OK) for n in range(3)]
    harness.rest()
    assert harness.position[0] == pytest.approx(end, abs=1e-5)


def refuse(*_):
    """Fail, instead of a function of the controller."""
    raise SpelError(2002, 'refused')


def tasks(harness):
    return [row.name for row in harness.controller.tasks()]


@pytest.mark.invariant(4)
def test_inv4_nothing_moves_after_an_estop_until_enabled():
    harness = OurProgramHarness()
    client = moving(harness)
    for event in ('E-stop press', 'E-stop release', 'reset', 'motors on'):
        harness.do(event)
        assert_still(harness)
        assert client.stream(*line(harness, 1))[-1] == (0, FAILURE)
    harness.do('motors off', 'start')
    harness.step(1.0)
    assert not harness.controller.condition.powered
    harness.do('motors on')
    assert_still(harness)
    assert_works(harness, client)


def test_points_waiting_at_an_estop_are_never_executed():
    """main drops the points in the ring without help of a server."""
    harness = OurProgramHarness()
    moving(harness)
    harness.do('E-stop press')
    harness.until(lambda: not harness.controller.in_motion)
    enable(harness)
    assert_still(harness)


def test_points_not_yet_passed_to_main_are_dropped_at_a_start():
    """main waits until MotionServer has dropped its points too."""
    harness = OurProgramHarness(LOOK_AHEAD='2')
    client = harness.ready()
    client.send_bytes(b''.join(line(harness, 6)))
    harness.step(0.6)
    assert client.replies() == [(0, OK), (1, OK)]
    harness.do('stop', 'start')
    assert_still(harness)
    assert client.replies() == [(n, FAILURE) for n in range(2, 6)]


def test_motors_off_in_a_pause_drops_the_points():
    harness = OurProgramHarness()
    client = harness.ready()
    harness.do('pause')
    assert client.stream(*line(harness, 3)) == [(n, OK) for n in range(3)]
    harness.do('motors off')
    harness.step(0.1)
    harness.do('motors on', 'continue')
    assert_still(harness)
    assert_works(harness, client)


def test_points_in_teach_mode_are_refused(monkeypatch):
    """Even if the motors are on, which the simulated controller does not allow."""
    harness = OurProgramHarness()
    client, state = harness.ready(), harness.connect('state')
    monkeypatch.setitem(WORDS['CtrlInfo'], 7, lambda _: 0)
    assert client.stream(*line(harness, 1)) == [(0, FAILURE)]
    assert state.status().error_code == 4031


@pytest.mark.parametrize('how', ['motors off', 'AbortMotion All'])
def test_aborted_motion_drops_the_points_and_main_continues(how):
    harness = OurProgramHarness()
    client, state = moving(harness), harness.connect('state')
    if how == 'motors off':
        harness.do(how)
        harness.until(lambda: not harness.controller.in_motion)
        harness.do('motors on')
    else:
        harness.controller.program.execute(how, lambda _: None)
    assert_still(harness)
    assert state.status().error_code == 2999
    assert harness.controller.program.failure is None
    assert_works(harness, client)


@pytest.mark.invariant(4)
def test_inv4_open_door_ends_main_and_the_motion():
    harness = OurProgramHarness()
    client = moving(harness)
    harness.do('door open')
    harness.step(0.5)
    assert tasks(harness) == ['BgMain', *SERVERS]
    assert client.stream(*line(harness, 1))[-1] == (0, FAILURE)
    harness.do('door close', 'continue')
    assert_still(harness)
    harness.do('start')
    assert_still(harness)
    assert_works(harness, client)


def test_without_door_ends_motion_main_waits_for_continue():
    """The door switches the motors off, which drops the points."""
    harness = OurProgramHarness(DOOR_ENDS_MOTION='')
    client = moving(harness)
    harness.do('door open')
    assert_still(harness)
    harness.do('door close', 'continue')
    assert_still(harness)
    assert_works(harness, client)


def test_stop_works_in_a_pause():
    harness = OurProgramHarness()
    client = harness.ready()
    harness.do('pause')
    assert client.stream(*line(harness, 3)) == [(n, OK) for n in range(3)]
    assert_still(harness, 1.0)
    assert client.stream(point(STOP)) == [(STOP, OK)]
    harness.do('continue')
    assert_still(harness)
    assert_works(harness, client)


@pytest.mark.invariant(4)
def test_inv4_lost_client_stops_the_arm_and_switches_motors_off():
    harness = OurProgramHarness()
    moving(harness).leave()
    assert_still(harness)
    assert not harness.controller.condition.powered
    client = harness.connect()
    assert client.stream(*line(harness, 1)) == [(0, FAILURE)]
    harness.do('motors on')
    assert_still(harness)
    assert_works(harness, client)


def test_config_may_keep_the_motors_on():
    harness = OurProgramHarness(LOST_CLIENT_MOTORS_OFF='')
    moving(harness).leave()
    assert_still(harness)
    assert harness.controller.condition.powered
    assert_works(harness, harness.connect())


def test_stop_bit_set_by_another_program_is_an_error():
    harness = OurProgramHarness()
    client, state = moving(harness), harness.connect('state')
    harness.controller.io.write(IoType.FLAG, 500, 1)
    assert_still(harness)
    assert state.status().error_code == 8003
    assert_works(harness, client)


@pytest.mark.invariant(2)
def test_inv2_shipped_program_uses_low_power():
    assert "\n'#define FULL_POWER 1\n" in OUR_FILES['config.inc']


def test_main_reports_tables_that_cannot_be_filled(monkeypatch):
    monkeypatch.setitem(VALUES, 'ppls', refuse)
    harness = OurProgramHarness()
    harness.step(6.0)
    assert harness.controller.error_number == 8002
    assert harness.controller.program.failure.position.file == 'main.prg'


def test_ended_server_is_restarted():
    harness = OurProgramHarness()
    harness.step(0.5)
    world = harness.controller.program.machine.world
    for number in (66, 67, 68):
        world.end(world.tasks[number])
    assert tasks(harness) == ['main', 'BgMain']
    harness.step(0.5)
    assert tasks(harness) == ['main', 'BgMain', *SERVERS]
    client = harness.ready()
    assert client.stream(*line(harness, 2)) == [(0, OK), (1, OK)]


def test_used_task_number_does_not_end_bgmain():
    harness = OurProgramHarness()
    harness.step(0.5)
    machine = harness.controller.program.machine
    machine.world.end(machine.world.tasks[66])
    machine.start('MoveAll', 66, TaskType.TRAP, clear=False)
    harness.step(0.5)
    assert 'BgMain' in tasks(harness)
    machine.world.end(machine.world.tasks[66])
    harness.step(0.5)
    assert set(SERVERS) <= set(tasks(harness))


@pytest.mark.parametrize('port', ['state', 'motion', 'io'])
def test_failed_write_ends_the_connection_not_the_server(port, monkeypatch):
    harness = OurProgramHarness()
    client = harness.connect(port)
    with monkeypatch.context() as patch:
        patch.setattr(harness.controller.program.network, 'send', refuse)
        client.send(request(Ping()))
        harness.step(0.3)
    assert not client.open
    client = harness.connect(port)
    client.send(request(Ping()))
    harness.step(0.3)
    assert reply(Ping(), ReplyCode.SUCCESS) in client.packets()
    assert harness.controller.program.failure is None


@pytest.mark.invariant(4)
def test_inv4_start_main_needs_motors_on():
    harness = OurProgramHarness(START_MAIN='1')
    client = moving(harness)
    harness.do('E-stop press', 'E-stop release')
    assert_still(harness)
    harness.do('reset')
    assert_still(harness)
    assert 'main' not in tasks(harness)
    harness.do('motors on')
    assert_still(harness)
    assert 'main' in tasks(harness)
    assert_works(harness, client)


def test_without_background_tasks_main_starts_the_servers():
    """The servers are NoEmgAbort and survive an E-stop."""
    harness = OurProgramHarness(NO_BACKGROUND='1')
    client, state = moving(harness), harness.connect('state')
    assert tasks(harness) == ['main', *SERVERS]
    harness.do('E-stop press')
    assert_still(harness)
    assert tasks(harness) == SERVERS
    assert state.status().e_stopped == 1
    assert client.stream(*line(harness, 1))[-1] == (0, FAILURE)
    enable(harness)
    assert_still(harness)
    assert_works(harness, client)


def test_error_between_two_clients_ends_no_server(monkeypatch):
    """Dropping points and switching outputs off may fail. The servers continue."""
    harness = OurProgramHarness()
    motion, io = harness.ready(), harness.connect('io')
    motion.stream(point(0, harness.position))
    io.send(request(IoWrite(1, (IoSetting(IoType.DIGITAL_OUTPUT, 3, 1),))))
    harness.step(0.1)
    with monkeypatch.context() as patch:
        patch.setattr(harness.controller.program, 'write_bits', refuse)
        motion.leave()
        io.leave()
        harness.step(1.0)
    assert harness.connect().open
    assert tasks(harness) == ['main', 'BgMain', *SERVERS]
