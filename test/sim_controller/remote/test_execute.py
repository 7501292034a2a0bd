# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""$Execute: statements, answers, timing and exclusive use of the arm."""

import re

import numpy as np
import pytest
from support.controller_harness import (
    LIMITS,
    SIMULATED,
    Harness,
    InlinePlanner,
    Remote,
    point,
)
from support.spel_program_harness import SpelProgramHarness

from epson_driver.sim_controller.condition.spel_settings import SETTINGS
from epson_driver.sim_controller.condition.states import Motors, Power, RejectedError
from epson_driver.simple_message import IoType
from epson_driver.spel.preprocess import line_tokens

BENT = np.radians([0.0, -10.0, 20.0, 0.0, -60.0, 0.0])
STEP_S = 0.004


def new_remote(**options):
    """Return a remote client of an enabled controller without a motion client."""
    remote = Remote(Harness(BENT, motors=False, connect=False, **options))
    remote.harness.do('motors on')
    return remote


@pytest.fixture
def remote():
    return new_remote()


@pytest.fixture
def execute(remote):
    return lambda statement: remote(f'Execute,"{statement}"')


def answers_after(remote, command='', seconds=20.0, during=lambda _: None):
    """Return the answers to a command, and the time until the last one, s."""
    result = remote.answers(f'${command}\r\n'.encode()) if command else []
    steps = int(seconds / STEP_S)
    for step in range(steps):
        if result and result[-1].startswith(('#Execute', '!Execute', '#Home')):
            return result, step * STEP_S
        remote.controller.step(STEP_S)
        during(step)
        text = remote.peer.take().decode()
        result += text.split('\r\n')[:-1]
    raise AssertionError(result)


@pytest.mark.invariant(7)
def test_executed_statements_do_not_fill_the_memory(execute):
    stored = line_tokens.cache_info().currsize
    execute('Print 1')
    execute('Print 2')
    assert line_tokens.cache_info().currsize == stored


# Statements


@pytest.mark.parametrize(
    ('statement', 'answer'),
    [
        ('Print 1+1', '#Execute,"2"'),
        ('print 1+1, 2 * 3', '#Execute,"2 6"'),
        ('Print Sqr(4), Agl(2)', '#Execute,"2 -10"'),
        ('Speed 20;Print Speed', '#Execute,"20"'),
        ('print Motor;', '#Execute,"1"'),
        ('On 3', '#Execute,0'),
        ('P1 = Here', '#Execute,0'),
        ('', '#Execute,0'),
        # quotes may occur inside and at the end
        ('print 1;print "RobotPosHere', '#Execute,"1\r\nRobotPosHere"'),
        ('print "a"', '#Execute,"a"'),
    ],
)
def test_statement_is_executed(remote, statement, answer):
    remote.connection.receive(f'$Execute,"{statement}"\r\n'.encode())
    assert remote.peer.take().decode() == f'{answer}\r\n'


@pytest.mark.parametrize(
    ('statement', 'number'),
    [
        ('If Sw(1) = On Then Reset', 12),  # p937: programs only
        ('Xqt main', 12),
        ('Quit All', 12),
        ('Integer i', 12),
        ('Print (1', 12),
        ('1 + 1', 12),
        ('Onn 3', 15),
        ('Print Nothing(1)', 15),
        ('Print Agl()', 15),
        ('Motor Maybe', 15),
        ('SFree 1', 15),
        ('Brake Off, 1', 15),
        ('SysConfig', 15),
        ('VRun seq1', 15),
        ('Print VGet', 15),
        ('Print Elbow(P99), DiffPoint(P98, P99)', 15),
        ('On 16', 99),
        ('Print 1 / 0', 99),
        ('Speed 120', 99),
    ],
)
def test_invalid_statement_is_refused(execute, remote, statement, number):
    assert execute(statement) == f'!Execute,{number}'
    assert execute('Print 1') == '#Execute,"1"'


def test_answer_repeats_the_spelling_of_the_command(remote):
    assert remote('execute,"print 1"') == '#execute,"1"'
    assert remote('getstatus').startswith('#getstatus,')
    assert remote('eXecute,print 1') == '!eXecute,12'


def test_point_is_printed_in_fixed_columns(execute):
    """Each coordinate has 12 characters: clients cut the text by columns."""
    text = execute('Print RealPos').removeprefix('#Execute,"')
    assert [text[at : at + 3] for at in range(0, 72, 12)] == [f' {item}:' for item in 'XYZUVW']
    assert float(text[3:12]) == pytest.approx(0.0, abs=1e-3)


def test_where_is_printed_in_fixed_columns(execute, remote):
    """X at byte 20, Y at 36, Z at 52, U at 68. Joints and pulses have separate lines."""
    remote.connection.receive(b'$Execute,"Where"\r\n')
    world, joint, pulse = remote.peer.take().decode().splitlines()
    assert world[10:16] == 'WORLD:'
    shown = [float(world[at : at + 9]) for at in (20, 36, 52, 68)]
    here = execute('Print Here').removeprefix('#Execute,"')
    assert shown == [float(here[3 + 12 * at : 12 + 12 * at]) for at in range(4)]
    remote('Execute,"Local 1, XY(100, 200, 0, 0)"')
    remote.connection.receive(b'$Execute,"Where 1"\r\n')
    local = remote.peer.take().decode().splitlines()[0]  # p890
    moved = [float(local[at : at + 9]) for at in (20, 36, 52, 68)]
    assert moved == pytest.approx([shown[0] - 100, shown[1] - 200, *shown[2:]])
    assert joint.startswith('JOINT:  1:    0.000 deg  2:  -10.000 deg')
    assert execute('Joint') == f'#Execute,"{joint}"'
    assert pulse.count('pls') == 6


def test_points_are_stored_and_can_be_changed(execute):
    assert execute('P1 = Here') == execute('P2 = P1 +Z(50)') == '#Execute,0'
    assert execute('Print CZ(P2) - CZ(P1)') == '#Execute,"50"'


def test_settings_changed_by_statements_are_returned_by_functions(execute):
    highest = (
        *('Speed 100', 'Accel 100, 100', 'SpeedFactor 100', 'SpeedS 2000', 'AccelS 25000'),
        *('SpeedR 1000', 'AccelR 5000', 'Weight 100', 'Inertia 1000'),
    )
    assert {item.split()[0] for item in highest} == SETTINGS.keys()
    for element in highest:
        assert execute(element) == '#Execute,0', element
        assert execute(re.sub('[0-9]+', '-1', element)) == '!Execute,99', element
    assert execute('Print Speed, Accel(1), SpeedS') == '#Execute,"100 100 2000"'


def test_statements_switch_motors_power_and_outputs(execute, remote):
    assert execute('Power High') == '#Execute,0'
    assert remote.controller.condition.power is Power.HIGH
    assert execute('MOTOR   off') == '#Execute,0'
    assert remote.controller.condition.motors is Motors.OFF
    assert execute('Out 1, 129') == '#Execute,0'
    assert remote.controller.io.read(IoType.DIGITAL_OUTPUT, 8) == 1
    assert execute('MemOn 7; Print MemSw(7), MemIn(0), Oport(9)') == '#Execute,"1 128 0"'


def test_sim_print_works_in_any_condition(remote):
    remote.harness.do('E-stop press', 'door open')
    assert remote('Sim,print,EStopOn,SafetyOn,SysErr') == '#Sim,-1 -1 2261'
    assert remote('Execute,"Print EStopOn"') == '!Execute,20'


# Motion


def angles(remote):
    return remote.controller.arm.commanded


@pytest.mark.parametrize('planner', [None, InlinePlanner()])
def test_answer_is_sent_when_the_arm_has_arrived(planner):
    remote = new_remote(planner=planner)
    assert remote('Execute,"P1 = Here"') == '#Execute,0'
    before = angles(remote)
    result, after = answers_after(remote, 'Execute,"Go P1 +Z(50)"')
    assert result == ['#Execute,0']
    assert after > 0.2
    assert not remote.controller.in_motion
    assert remote('Execute,"Print CZ(Here) - CZ(P1)"').startswith('#Execute,"50')
    answers_after(remote, 'Execute,"Move P1"')
    assert angles(remote) == pytest.approx(before, abs=1e-4)


@pytest.mark.invariant(2)
def test_inv2_execute_exceeds_no_limit_and_points_may_follow():
    remote = new_remote()
    speeds = []
    answers_after(
        remote,
        'Execute,"Power High; Speed 100; Accel 100, 100; Move Here +X(10); Go Here +X(-20)"',
        during=lambda _: speeds.append(np.abs(remote.controller.arm.executor.velocity)),
    )
    assert np.all(np.max(speeds, axis=0) <= LIMITS.velocity)
    assert np.max(speeds) > 0.1
    there = angles(remote)
    remote.harness.connect()
    remote.harness.send(point(0, tuple(there[:1] + 0.1)))
    remote.harness.rest()
    assert angles(remote)[0] == pytest.approx(there[0] + 0.1, abs=1e-6)


def test_next_command_is_accepted_right_after_the_answer():
    """Servos lag behind the command. The answer waits for them, like Ready."""
    remote = new_remote(profile=SIMULATED)
    assert answers_after(remote, 'Execute,"Go Here +Z(20)"')[0] == ['#Execute,0']
    assert remote('Execute,"Print 1"') == '#Execute,"1"'


def test_several_statements_are_one_command(remote):
    result, _ = answers_after(remote, 'Execute,"Go Here +Z(20);Go Here +Z(-20);Print 7"')
    assert result == ['#Execute,"7"']


def test_commands_not_allowed_in_motion_return_error_21(remote, caplog):
    remote.connection.receive(b'$Execute,"Go Here +Z(50)"\r\n')
    assert remote('Execute,"Print 1"') == '!Execute,21'
    assert remote('GetIO,1') == '!GetIO,21'
    assert remote('Sim,print,1') == '!Sim,21'
    assert not caplog.records  # a driver asks for I/O twice a second
    assert len(remote('Sim,joints').split()) == 6
    assert remote('SetIO,1,1') == '#SetIO,0'
    assert remote('GetStatus').startswith('#GetStatus,')
    assert answers_after(remote)[0] == ['#Execute,0']
    assert remote('GetIO,1') == '#GetIO,0'


@pytest.mark.invariant(3)
def test_inv3_abort_brakes_and_ends_the_command(remote):
    remote.connection.receive(b'$Execute,"Go Here +Z(80)"\r\n')
    for _ in range(50):
        remote.controller.step(STEP_S)
    assert remote.controller.in_motion
    assert remote('Abort') == '#Abort,0'
    assert answers_after(remote)[0] == ['!Execute,99']
    for _ in range(100):
        remote.controller.step(STEP_S)
    assert not remote.controller.in_motion
    assert remote('Abort') == '#Abort,0'


@pytest.mark.invariant(3, 4)
@pytest.mark.parametrize('event', ['E-stop press', 'door open', 'motors off', 'stop'])
def test_inv3_and_4_event_that_stops_the_arm_ends_the_command(remote, event):
    remote.connection.receive(b'$Execute,"Go Here +Z(80);Go Here +Z(-80)"\r\n')
    for _ in range(50):
        remote.controller.step(STEP_S)
    remote.harness.do(event)
    assert answers_after(remote)[0] == ['!Execute,99']
    for _ in range(300):
        remote.controller.step(STEP_S)
    stopped = angles(remote)
    for back in ('E-stop release', 'door close', 'reset', 'motors on', 'start', 'continue'):
        try:
            remote.harness.do(back)
        except RejectedError:  # not applicable after this event
            continue
    for _ in range(300):
        remote.controller.step(STEP_S)
    assert angles(remote).tolist() == stopped.tolist()


@pytest.mark.invariant(1)
def test_inv1_motion_client_excludes_execute():
    remote = Remote(Harness(BENT))
    assert remote('Execute,"Go Here +Z(20)"') == '!Execute,20'
    assert remote('Sim,why') == '#Sim,the client of the motion port controls the arm'
    assert not remote.controller.in_motion


@pytest.mark.invariant(1)
def test_inv1_new_motion_client_ends_the_command(remote):
    remote.connection.receive(b'$Execute,"Go Here +Z(80)"\r\n')
    for _ in range(50):
        remote.controller.step(STEP_S)
    remote.harness.connect()
    remote.harness.send(point(0))
    assert [reply.reply_code for reply in remote.harness.replies()] == [2]
    assert answers_after(remote)[0] == ['!Execute,99']


def test_impossible_motion_shows_its_error_until_reset(remote):
    assert remote('Execute,"Go XY(0, 0, 5000, 0, 0, 0)"') == '!Execute,99'
    assert remote('GetStatus').endswith(',4007')
    assert remote('Execute,"Print 1"') == '!Execute,20'
    assert remote('Reset') == '#Reset,0'
    assert remote('Execute,"Print 1"') == '#Execute,"1"'


def test_home_requires_homeset(remote):
    assert remote('Home,0') == '!Home,99'
    assert remote('Sim,why').startswith('#Sim,error 2228: Home: no home position is defined')
    assert remote('Execute,"HomeSet 0,0,0"') == '!Execute,12'
    assert remote('Execute,"HomeSet 0,0,0,0,0,100000"') == '#Execute,0'
    assert answers_after(remote, 'Home,0')[0] == ['#Home,0']
    assert remote('Execute,"Print Pls(6), AtHome"') == '#Execute,"100000 -1"'
    assert answers_after(remote, 'Execute,"Pulse 0,0,0,0,0,0"')[0] == ['#Execute,0']
    assert remote('Execute,"HomeSet 999999999,0,0,0,0,0"') == '!Execute,99'


def test_disconnected_client_gets_no_answer(remote):
    remote.connection.receive(b'$Execute,"Go Here +Z(20)"\r\n')
    remote.connection.closed()
    for _ in range(1000):
        remote.controller.step(STEP_S)
    assert remote.peer.take() == b''
    again = Remote(remote.harness)
    assert again('Execute,"Print 1"') == '#Execute,"1"'


# With a program


def test_command_uses_the_globals_and_points_of_the_program():
    source = 'Global Integer g\nFunction main\n  g = 3\n  P5 = XY(1, 2, 3, 4)\nFend'
    harness = SpelProgramHarness(source, start=BENT)
    remote = Remote(harness)
    remote.controller.step(STEP_S)
    assert remote('Execute,"Print g, CY(P5)"') == '#Execute,"3 2"'
    assert remote('Execute,"g = 4; Print g"') == '#Execute,"4"'
    assert remote('SetMotorsOn,1') == '#SetMotorsOn,0'
    result, after = answers_after(remote, 'Execute,"Go Here +Z(20)"')
    assert result == ['#Execute,0']
    assert after > 0.1


def test_execute_is_refused_while_a_program_runs():
    source = 'Function main\n  Do\n    Wait 1\n  Loop\nFend'
    remote = Remote(SpelProgramHarness(source))
    remote.controller.step(STEP_S)
    assert remote('Execute,"Print 1"') == '!Execute,20'
    assert remote('Sim,why') == '#Sim,the program runs: stop first'
