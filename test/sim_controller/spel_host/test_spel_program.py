# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ programs run the simulated controller: tasks, motion, E-stop, pause, bits, Print."""

import logging

import numpy as np
import pytest
from support.controller_harness import MODEL, PROFILE, Peer
from support.spel_program_harness import SpelProgramHarness

from epson_driver.error_texts import load_error_texts
from epson_driver.sim_controller.assembly import new_controller, program_network
from epson_driver.sim_controller.condition.states import Tasks
from epson_driver.sim_controller.spel_host.spel_program import SpelSource
from epson_driver.spel import ErrorNumber, build

AWAY = np.radians([30.0, -10.0, 10.0, 0.0, 20.0, 0.0])
MOVE = """
Function main
  Motor On
  Power High
  Speed 30
  Accel 60, 60
  Print "goes"
  Go AglToPls(30, -10, 10, 0, 20, 0)
  Print "there"
  Wait 0.1
Fend
"""


def test_go_reaches_its_point_before_the_next_statement(caplog):
    harness = SpelProgramHarness(MOVE, caplog)
    harness.until(lambda: 'there' in harness.printed)
    assert np.allclose(harness.position, AWAY, atol=1e-9)
    assert not harness.controller.arm.executor.moving
    harness.step(0.2)
    assert harness.controller.condition.tasks is Tasks.STOPPED  # main is over
    assert harness.tasks == []
    harness.assert_within_limits()


@pytest.mark.invariant(1)
def test_motion_with_motors_off_is_error_4031_at_file_and_line(caplog):
    harness = SpelProgramHarness(
        '\nFunction main\n  Wait 0.1\n  Go AglToPls(1, 0, 0, 0, 0, 0)\nFend\n', caplog
    )
    harness.step(0.5)
    assert harness.controller.error_number == 4031
    assert any('main.prg:4: error 4031' in message for message in caplog.messages)
    assert not np.any(np.diff(harness.positions, axis=0))


@pytest.mark.invariant(4)
@pytest.mark.parametrize('seconds', [0.15, 0.25, 0.35])
def test_inv4_estop_in_motion_ends_the_task_until_start(caplog, seconds):
    """Nothing moves before each step of enabling is done."""
    source = MOVE.replace('Motor On', 'Wait Motor = On')
    harness = SpelProgramHarness(source, caplog)
    harness.step(0.1)
    assert harness.tasks == ['main waits main.prg:3']
    harness.do('motors on')
    harness.until(lambda: 'goes' in harness.printed)
    harness.step(seconds)
    assert np.any(harness.velocity)
    harness.do('E-stop press')
    harness.step(2.0)
    harness.assert_within_limits()
    rested = harness.position
    assert harness.tasks == []
    assert 'there' not in harness.printed
    for events in (['E-stop release'], ['reset'], ['motors on']):
        harness.do(*events)
        harness.step(1.0)
        assert np.array_equal(harness.position, rested)
        assert harness.tasks == []
    harness.do('start')
    harness.until(lambda: 'there' in harness.printed)
    assert np.allclose(harness.position, AWAY, atol=1e-9)
    assert caplog.text.count('goes') == 2


@pytest.mark.invariant(4)
def test_inv4_started_program_does_not_move_with_motors_off(caplog):
    harness = SpelProgramHarness(MOVE.replace('Motor On', 'Wait Motor = On'), caplog)
    harness.do('E-stop press', 'E-stop release', 'reset', 'start')
    harness.step(1.0)
    assert harness.tasks == ['main waits main.prg:3']
    assert not np.any(np.diff(harness.positions, axis=0))


@pytest.mark.invariant(4)
def test_inv4_program_cannot_enable_motors_during_an_estop(caplog):
    source = """
    Function BgMain
      OnErr GoTo failed
    again:
      Wait 0.1
      Reset Error
      StartMain main
      GoTo again
    failed:
      Print "refused", Err
      EResume again
    Fend
    Function main
      OnErr GoTo failed
      Motor On
      Print "on"
      Exit Function
    failed:
      Print "failed", Err
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.do('E-stop press')
    harness.step(1.0)
    assert not harness.controller.condition.powered
    harness.do('E-stop release')
    harness.step(1.0)
    assert not harness.controller.condition.powered
    assert harness.controller.condition.estopped
    assert set(harness.printed) == {'refused 2261'}
    assert [task.split()[0] for task in harness.tasks] == ['BgMain']


def test_wait_takes_its_time_after_a_late_start_and_a_pause(caplog):
    """Times are measured from the start or continuation of the task."""
    source = """
    Function main
      Print "begins"
      Wait 0.5
      Print "waited"
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.step(3.0)
    assert harness.printed == ['begins', 'waited']
    harness.do('start')
    harness.step(0.4)
    assert harness.printed == ['begins', 'waited', 'begins']
    harness.do('pause')
    harness.step(3.0)
    harness.do('continue')
    harness.step(0.4)
    assert harness.printed[2:] == ['begins']
    harness.step(0.2)
    assert harness.printed[2:] == ['begins', 'waited']


def test_pause_holds_task_and_arm_until_continue(caplog):
    harness = SpelProgramHarness(MOVE, caplog)
    harness.until(lambda: 'goes' in harness.printed)
    harness.step(0.2)
    harness.do('pause')
    harness.step(1.0)
    held = harness.position
    assert not np.allclose(held, AWAY, atol=1e-3)
    assert harness.tasks == ['main paused main.prg:8']
    harness.step(1.0)
    assert np.array_equal(harness.position, held)
    harness.do('continue')
    harness.until(lambda: 'there' in harness.printed)
    assert np.allclose(harness.position, AWAY, atol=1e-9)
    assert harness.within_limits()[0] <= 1.001


def test_only_motions_with_cp_blend(caplog):
    source = """
    Function main
      Motor On
      Power High
      Speed 50
      Accel 50, 50
      Go AglToPls(20, 0, 0, 0, 0, 0) {cp}
      Wait 0.02
      Go AglToPls(40, 0, 0, 0, 0, 0)
      Print "there"
    Fend
    """
    slowest = {}
    for cp in ('CP', ''):
        caplog.clear()
        harness = SpelProgramHarness(source.format(cp=cp), caplog)
        harness.until(lambda harness=harness: 'there' in harness.printed)
        assert np.allclose(harness.position, np.radians([40, 0, 0, 0, 0, 0]), atol=1e-9)
        speeds = np.diff(np.array(harness.positions)[:, 0])
        middle = (np.array(harness.positions)[:-1, 0] > 0.2) & (
            np.array(harness.positions)[:-1, 0] < 0.6
        )
        slowest[cp] = float(speeds[middle].min())
        harness.assert_within_limits()
    assert slowest[''] < 1e-6
    assert slowest['CP'] > 1e-4


def test_till_stops_the_arm_without_an_error(caplog):
    source = """
    Function main
      Motor On
      Power High
      Speed 20
      Till MemSw(7) = On
      Xqt 2, stopper, NoEmgAbort
      Go AglToPls(60, 0, 0, 0, 0, 0) Till
      Print "till", TillOn
      Wait 0.1
      Go AglToPls(0, 0, 0, 0, 0, 0)
      Print "till", TillOn
    Fend
    Function stopper
      Wait 0.4
      MemOn 7
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.until(lambda: harness.printed[-1:] == ['till -1'])
    assert 0.0 < harness.position[0] < np.radians(59.0)
    assert not np.any(harness.velocity)
    harness.until(lambda: harness.printed[-1:] == ['till 0'])
    assert harness.position[0] == pytest.approx(0.0, abs=1e-9)


def test_abortmotion_ends_go_with_error_2999(caplog):
    source = """
    Function main
      OnErr GoTo failed
      Motor On
      Xqt 2, stopper, NoEmgAbort
      Go AglToPls(60, 0, 0, 0, 0, 0)
      Print "there"
      Exit Function
    failed:
      Print "error", Err
      EResume ready
    ready:
      Go AglToPls(0, 0, 0, 0, 0, 0)
      Print "back"
    Fend
    Function stopper
      OnErr GoTo failed
      Wait 0.4
      AbortMotion All
      Wait 10
      AbortMotion All
    failed:
      Print "stopper", Err
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.until(lambda: len(harness.printed) == 3)
    assert harness.printed == ['error 2999', 'back', 'stopper 2998']
    harness.assert_within_limits()


def test_abortmotion_ends_a_wait_of_the_moving_task(caplog):
    """The error belongs to the moving task, not to the aborting one (p65)."""
    source = """
    Function main
      OnErr GoTo failed
      Motor On
      Go AglToPls(1, 0, 0, 0, 0, 0)
      Xqt 2, stopper, NoEmgAbort
      Wait Sw(1)
    failed:
      Print "main", Err
    Fend
    Function stopper
      Wait 0.4
      AbortMotion 1
      Print "stopper"
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.until(lambda: len(harness.printed) == 2)
    assert set(harness.printed) == {'main 2998', 'stopper'}


@pytest.mark.invariant(3)
def test_inv3_trap_goto_brakes_the_arm(caplog):
    """The statement ends, and the next one starts from the current position (p852)."""
    source = """
    Function main
      Motor On; Power High
      Xqt input_3
      Trap 1, Sw(3) = On GoTo sprung
      Go AglToPls(60, 0, 0, 0, 0, 0)
      Print "never"
    sprung:
      Wait 1
      Print Int(Agl(1)) < 60
      Go AglToPls(0, 0, 0, 0, 0, 0)
      Print "back"
    Fend
    Function input_3
      Wait 0.3; SetSw 3, On
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.until(lambda: len(harness.printed) == 2)
    assert harness.printed == ['-1', 'back']
    harness.assert_within_limits()


def test_till_without_a_condition_tests_input_0(caplog):
    """The condition at power on (p829)."""
    source = """
    Function main
      Motor On
      SetSw 0, On
      Go AglToPls(60, 0, 0, 0, 0, 0) Till
      Print TillOn, Agl(1) < 1
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.until(lambda: harness.printed)
    assert harness.printed == ['-1 -1']


def test_statement_not_simulated_ends_its_task(caplog):
    source = 'Function main\n  If Motor = On Then\n    SFree 1\n  EndIf\n  SFree 2\nFend\n'
    harness = SpelProgramHarness(source, caplog)
    harness.step(0.1)
    assert harness.controller.error_number == 9999
    assert 'main.prg:5' in caplog.text
    assert 'SFree is not simulated' in caplog.text


def test_motors_off_end_the_motion_with_error_2999(caplog):
    harness = SpelProgramHarness(MOVE, caplog)
    harness.until(lambda: 'goes' in harness.printed)
    harness.step(0.3)
    assert np.any(harness.velocity)
    harness.do('motors off')
    harness.step(1.0)
    assert not harness.controller.condition.powered
    assert harness.controller.error_number == 2999
    harness.assert_within_limits()


@pytest.mark.invariant(3)
def test_inv3_quit_of_a_moving_task_stops_the_arm(caplog):
    source = """
    Function BgMain
      Wait 0.4
      Quit main
      Print "quit"
    Fend
    Function main
      Motor On
      Go AglToPls(90, 0, 0, 0, 0, 0)
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.until(lambda: 'quit' in harness.printed)
    harness.step(1.0)
    assert 0.0 < harness.position[0] < np.radians(60.0)
    assert not np.any(harness.velocity)
    harness.assert_within_limits()


@pytest.mark.invariant(4)
def test_inv4_continue_does_not_restart_an_ended_program(caplog):
    source = """
    Function BgMain
      Wait PauseOn = True
      Quit main
    Fend
    Function main
      Print "begins"
      Wait 1000
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.step(0.1)
    harness.do('pause')
    harness.step(0.1)
    harness.do('continue')
    harness.step(0.5)
    assert harness.printed == ['begins']
    assert harness.controller.condition.tasks is Tasks.STOPPED


def test_robot_functions_return_values_of_the_arm(caplog):
    source = """
    Function main
      Motor On
      Go AglToPls(10, 0, 0, 0, 0, 0)
      Wait 0.2
      Print Agl(1), RealPls(1) - Pls(1), PPls(AglToPls(10, 0, 0, 0, 0, 0), 1) - Pls(1)
      Print Motor, EStopOn, CtrlInfo(7), InPos, Speed, Accel(1), RobotType
      Print JRange(1, 1) < JRange(1, 2), TargetOK(AglToPls(500, 0, 0, 0, 0, 0))
      P1 = Here
      Go P1 :Z(CZ(P1) - 20)
      Print Int(CZ(P1) - CZ(Here) + 0.5), TargetOK(XY(9000, 0, 0, 0, 0, 0))
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.until(lambda: len(harness.printed) == 4)
    assert harness.printed == ['10 0 0', '1 0 1 -1 5 5 5', '-1 0', '20 0']


def test_program_reads_inputs_and_sets_outputs_of_the_controller(caplog):
    source = """
    Function main
      Wait Sw(3) = On
      On 5
      MemOn 7
      Out 1, &H81
      Print "seen", Sw(3), Oport(5), MemSw(7), OutW(0)
      On 400
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    io = harness.controller.io
    harness.step(0.2)
    io.set_input(1, 3, 1)
    harness.step(0.2)
    assert harness.printed == ['seen 1 1 1 33056']
    assert [io.read(2, bit) for bit in (5, 8, 15)] == [1, 1, 1]
    assert harness.controller.error_number == 9993  # output 400 does not exist


def test_program_sets_inputs_like_virtual_io(caplog):
    body = 'SetSw 1, On; SetIn 1, 5; Print In(0), In(1); SetInW 0, 258; Print InW(0); SetIn 50, 1'
    harness = SpelProgramHarness(f'Function main\n{body}\nFend', caplog)
    harness.step(0.2)
    assert harness.printed == ['2 5', '258']
    assert harness.controller.error_number == 9993  # input 400 does not exist


def test_unhandled_error_ends_the_tasks_and_switches_motors_off(caplog):
    source = """
    Function main
      Motor On
      Xqt 2, other
      Go AglToPls(60, 0, 0, 0, 0, 0)
    Fend
    Function other
      Wait 0.5
      Error 8123
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.step(1.5)
    assert harness.controller.error_number == 8123
    assert not harness.controller.condition.powered
    assert harness.tasks == ['other aborted main.prg:9']
    assert not np.any(harness.velocity)
    harness.do('reset')
    harness.step(0.1)
    assert harness.tasks == []
    assert harness.controller.error_number == 0


def answer(controller, command):
    """Return the answer of the remote port to one command."""
    peer = Peer()
    remote = controller.connect('remote', peer)
    remote.receive(f'$Login\r\n${command}\r\n'.encode())
    remote.closed()
    return peer.take().decode().splitlines()[-1]


def test_error_is_reported_with_text_file_and_line(caplog):
    source = '\nFunction main\n  Integer a(3), i\n  i = 7\n  a(i) = 1\nFend\n'
    harness = SpelProgramHarness(source, caplog)
    harness.step(0.1)
    errors = [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR]
    text = 'an array index is out of range: it goes from 0 to UBound'
    assert errors == [f'main.prg:5: error 9992 in main (task 1): {text}']
    message = f'{text}, at main.prg:5 in main (task 1)'
    assert answer(harness.controller, 'GetErrMsg,9992,0') == f'#GetErrMsg,{message}'
    assert answer(harness.controller, 'Start,0') == '!Start,20'
    assert 'error 9992 (an array index' in caplog.text
    harness.do('reset')
    assert (
        answer(harness.controller, 'GetErrMsg,9992,0')
        == '#GetErrMsg,an array index is out of range (simulated controller)'
    )
    assert 'see the manual' not in caplog.text


def test_user_error_has_the_text_of_the_project(caplog):
    files = {
        'main.prg': 'Function main\n  Error BAD_PART\nFend\n',
        'UserErrors.dat': 'Label1 {\nnError=8100\nsLabel="BAD_PART"\n'
        'sMessage="The part is bad"\n}\n',
    }
    controller = new_controller(
        MODEL, PROFILE, spel=SpelSource(build(files), program_network(PROFILE))
    )
    controller.step(0.1)
    assert controller.error_text(8100) == 'The part is bad, at main.prg:2 in main (task 1)'
    assert 'The part is bad' in caplog.text


def test_every_error_number_of_the_language_has_a_text():
    assert set(ErrorNumber) <= set(load_error_texts('epson'))


def test_boot_keeps_only_preserved_variables(caplog):
    source = """
    Global Preserve Integer boots
    Global Integer other
    Function main
      boots = boots + 1
      other = other + 1
      Print "boot", boots, other
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.step(0.1)
    harness.do('boot')
    harness.step(0.1)
    harness.do('start')
    harness.step(0.1)
    assert harness.printed == ['boot 1 1', 'boot 2 1', 'boot 3 1']
