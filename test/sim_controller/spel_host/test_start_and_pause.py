# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Control of the controller by programs: StartMain, Reset, Pause, Cont, motors, two movers."""

import numpy as np
import pytest
from support.spel_program_harness import SpelProgramHarness

from epson_driver.sim_controller.condition.states import Tasks
from epson_driver.simple_message import ByteOrder, Frame

AWAY = np.radians([30.0, 0.0, 0.0, 0.0, 0.0, 0.0])


STARTING = """
Function BgMain
  OnErr GoTo refused
again:
  Wait Sw(1) = On
  StartMain main
  Wait Sw(1) = Off
  GoTo again
refused:
  Print "refused", Err
  Wait Sw(1) = Off
  EResume again
Fend
Function main
  If Motor = On Then Go AglToPls(30, 0, 0, 0, 0, 0)
  Print "main"
Fend
"""


def press(harness):
    """Press and release the button with which BgMain starts main."""
    harness.controller.io.set_input(1, 1, 1)
    harness.step(0.1)
    harness.controller.io.set_input(1, 1, 0)
    harness.step(0.1)


def test_startmain_starts_main_which_moves_the_arm(caplog):
    harness = SpelProgramHarness(STARTING, caplog)
    harness.step(0.1)
    assert harness.printed == ['main']
    assert harness.controller.condition.tasks is Tasks.STOPPED
    harness.do('motors on')
    press(harness)
    assert harness.controller.condition.tasks is Tasks.RUNNING
    assert [task.split()[0] for task in harness.tasks] == ['main', 'BgMain']
    harness.until(lambda: harness.printed == ['main', 'main'])
    assert np.allclose(harness.position, AWAY, atol=1e-9)
    harness.step(0.1)
    assert harness.controller.condition.tasks is Tasks.STOPPED
    assert harness.controller.error_number == 0


@pytest.mark.invariant(4)
def test_inv4_startmain_is_refused_until_an_estop_is_reset(caplog):
    harness = SpelProgramHarness(STARTING, caplog)
    harness.step(0.1)
    for event in ('E-stop press', 'E-stop release'):
        harness.do(event)
        press(harness)
    assert harness.printed == ['main', 'refused 2261', 'refused 2261']
    assert [task.split()[0] for task in harness.tasks] == ['BgMain']
    harness.do('reset')
    press(harness)
    assert harness.printed[3:] == ['main']
    assert not np.any(np.diff(harness.positions, axis=0))


@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    ('event', 'back', 'why'),
    [
        ('mode manual', 'mode auto', 'start: the key switch is at MANUAL: turn it to AUTO first'),
        ('door open', 'door close', 'start: the safeguard door is open: close it first'),
    ],
)
def test_inv4_startmain_is_refused_like_start(caplog, event, back, why):
    source = STARTING.replace('"refused", Err', '"refused", Err, ErrMsg$(Err)')
    source = source.replace('OnErr GoTo refused', 'OnErr GoTo refused' if back else '')
    harness = SpelProgramHarness(source, caplog)
    harness.step(0.1)
    harness.do(event)
    press(harness)
    assert harness.printed[1].startswith('refused 2261')
    assert [task.split()[0] for task in harness.tasks] == ['BgMain']
    harness.do(back)
    press(harness)
    assert harness.printed[2:] == ['main']
    unhandled = SpelProgramHarness(source.replace('OnErr GoTo refused', ''), caplog)
    unhandled.step(0.1)
    unhandled.do(event)
    press(unhandled)
    assert f'error 2261 in BgMain (task 65): {why}' in caplog.text


@pytest.mark.parametrize(
    ('event', 'why'),
    [
        ('mode manual', 'motors on: the key switch is at MANUAL: turn it to AUTO first'),
        ('door open', 'motors on: the safeguard door is open: close it first'),
    ],
)
@pytest.mark.invariant(4)
def test_inv4_motor_on_is_refused_like_motors_on(caplog, event, why):
    source = """
    Function main
      Xqt 2, switch, NoPause
      Wait 10
    Fend
    Function switch
      Wait Sw(1) = On
      Motor On
      Print "on"
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.step(0.1)
    harness.do(event)
    press(harness)
    assert f'main.prg:8: error 4031 in switch (task 2): {why}' in caplog.text
    assert harness.printed == []
    assert not harness.controller.condition.powered


def test_background_task_resets_an_error_once_the_arm_is_at_rest(caplog):
    source = """
    Function BgMain
      OnErr GoTo brakes
      Wait ErrorOn
      Print "error", SysErr
      Reset Error
      Print "reset", SysErr, Motor
      Wait 1000
    brakes:
      Print "refused", Err
      Wait 0.1
      EResume
    Fend
    Function main
      Xqt 2, other
      Motor On
      Go AglToPls(90, 0, 0, 0, 0, 0)
    Fend
    Function other
      Wait 0.6
      Error 8123
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.until(lambda: 'reset 0 0' in harness.printed)
    first, *refused, last = harness.printed
    assert (first, last) == ('error 8123', 'reset 0 0')
    assert refused
    assert set(refused) == {'refused 2261'}
    assert harness.controller.error_number == 0
    assert harness.controller.condition.tasks is Tasks.STOPPED
    rested = harness.position
    harness.step(1.0)
    assert np.array_equal(harness.position, rested)
    assert [task.split()[0] for task in harness.tasks] == ['BgMain']
    harness.assert_within_limits()


PAUSING = """
Function BgMain
  Wait Sw(1) = On
  Pause
  Print "paused", PauseOn
  Wait Sw(2) = On
  Cont
  Print "continued"
  Wait 1000
Fend
Function main
  Motor On
  Print "goes"
  Go AglToPls(30, 0, 0, 0, 0, 0)
  Print "there"
Fend
"""


def test_pause_statement_holds_arm_and_tasks_until_cont(caplog):
    harness = SpelProgramHarness(PAUSING, caplog)
    harness.step(0.6)
    harness.controller.io.set_input(1, 1, 1)
    harness.step(1.5)
    held = harness.position
    assert 0.0 < held[0] < AWAY[0] - 1e-3
    assert harness.controller.condition.tasks is Tasks.PAUSED
    assert 'main paused main.prg:14' in harness.tasks
    harness.step(1.0)
    assert np.array_equal(harness.position, held)
    harness.controller.io.set_input(1, 2, 1)
    harness.until(lambda: 'there' in harness.printed)
    assert np.allclose(harness.position, AWAY, atol=1e-9)
    harness.assert_within_limits()


@pytest.mark.invariant(4)
def test_inv4_cont_is_refused_while_the_door_is_open(caplog):
    """Neither tasks nor arm continue before the operator's continue."""
    harness = SpelProgramHarness(PAUSING, caplog)
    harness.step(0.6)
    harness.do('door open')
    harness.controller.io.set_input(1, 1, 1)
    harness.step(1.0)
    harness.controller.io.set_input(1, 2, 1)
    harness.step(1.0)
    assert 'continued' in harness.printed
    text = 'the program requests continue: the safeguard door is open: close it, then continue'
    assert text in caplog.text
    assert 'main paused main.prg:14' in harness.tasks
    assert harness.controller.condition.tasks is Tasks.INTERRUPTED
    harness.do('door close')
    held = harness.position
    harness.step(1.0)
    assert np.array_equal(harness.position, held)
    assert 'main paused main.prg:14' in harness.tasks
    harness.do('continue')
    harness.until(lambda: 'there' in harness.printed)
    assert np.allclose(harness.position, AWAY, atol=1e-9)


def test_tasks_continue_after_the_arm_has_returned(caplog):
    """After the door, Cont first returns the arm to its path. Statements wait for it."""
    harness = SpelProgramHarness(PAUSING, caplog)
    harness.step(0.6)
    harness.do('door open')
    harness.controller.io.set_input(1, 1, 1)
    harness.step(1.0)
    harness.do('door close')
    harness.step(0.1)
    harness.controller.io.set_input(1, 2, 1)
    harness.until(lambda: 'continued' in harness.printed)
    while harness.controller.condition.tasks is Tasks.RECOVERING:
        assert 'main paused main.prg:14' in harness.tasks
        harness.step(0.002)
    harness.until(lambda: 'there' in harness.printed)
    assert np.allclose(harness.position, AWAY, atol=1e-9)
    harness.assert_within_limits()


def test_cont_without_a_pause_is_logged_and_changes_nothing(caplog):
    harness = SpelProgramHarness('Function main\n  Cont\n  Print "on"\nFend\n', caplog)
    harness.step(0.1)
    assert harness.printed == ['on']
    assert 'the program requests continue: ' in caplog.text
    assert harness.controller.error_number == 0


def test_second_task_cannot_move_the_arm_during_a_motion(caplog):
    source = """
    Function main
      Motor On
      Xqt 2, second
      Go AglToPls(30, 0, 0, 0, 0, 0)
      Print "there"
    Fend
    Function second
      OnErr GoTo failed
      Wait 0.2
      Go AglToPls(-30, 0, 0, 0, 0, 0)
      Print "never"
    failed:
      Print "failed", Err
    Fend
    """
    harness = SpelProgramHarness(source, caplog)
    harness.until(lambda: len(harness.printed) == 2)
    assert harness.printed == ['failed 2999', 'there']
    assert np.allclose(harness.position, AWAY, atol=1e-9)


def test_motion_started_during_braking_waits_for_rest(caplog):
    """A straight line after AbortMotion starts from the rest position."""
    source = """
    Function main
      OnErr GoTo aborted
      Motor On; Power High; SpeedS 100
      Speed 50; Accel 30, 30
      Xqt 2, stopper
      Go AglToPls(40, -10, 20, 0, -60, 0)
      Print "never"
    aborted:
      Print "aborted", Err
      Move Here +Z(20)
      Print "there"
    Fend
    Function stopper
      Wait 0.3
      AbortMotion All
    Fend
    """
    start = np.radians([0.0, -10.0, 20.0, 0.0, -60.0, 0.0])
    harness = SpelProgramHarness(source, caplog, start=start)
    harness.until(lambda: 'there' in harness.printed)
    assert harness.printed == ['aborted 2999', 'there']
    assert harness.position[0] < np.radians(39.0)
    harness.assert_within_limits()
    assert harness.controller.error_number == 0


def test_program_without_main_ends_immediately(caplog):
    source = 'Function BgMain\n  Print "background"\n  Wait 1000\nFend\n'
    harness = SpelProgramHarness(source, caplog)
    harness.step(0.1)
    assert harness.controller.condition.tasks is Tasks.STOPPED
    harness.do('start')
    harness.step(0.1)
    assert harness.controller.condition.tasks is Tasks.STOPPED
    assert harness.printed == ['background']
    assert harness.controller.error_number == 0


def test_invalid_main_is_an_error_of_the_controller(caplog):
    harness = SpelProgramHarness('Function main(n As Integer)\nFend\n', caplog)
    harness.step(0.1)
    assert harness.controller.error_number == 9993
    assert 'main is not started: error 9993: main has 1 parameters' in caplog.text
    assert harness.tasks == []


def test_idle_loop_executes_few_statements_and_refuses_frames(caplog):
    harness = SpelProgramHarness('Function main\n  Do\n    Wait 0.1\n  Loop\nFend\n', caplog)
    harness.step(0.05)
    program = harness.controller.program
    before = program.machine.statements
    harness.step(1.0)
    assert 10 <= program.machine.statements - before <= 40
    assert program.ready
    frame = Frame(11, 2, 0, bytes(40), ByteOrder.LITTLE)
    with pytest.raises(RuntimeError, match=r'a SPEL\+ program accepts no frame \(11\)'):
        program.receive(frame)


@pytest.mark.parametrize(
    ('statement', 'events', 'sprung'),
    [
        ('Wait 9', ['pause', 'continue'], ['pause']),
        ('Wait 9', ['door open', 'door close'], ['open', 'close']),
        ('Wait 9', ['stop'], ['abort']),
        ('Wait 9', ['E-stop press'], ['emergency 261']),
        ('Error 8005', [], ['error 8005 0 0']),
        ('Go AglToPls(500, 0, 0, 0, 0, 0)', [], ['error 4001 1 0']),
        ('Print "over"', [], ['over', 'finish']),
    ],
)
def test_system_state_trap_starts_its_function(caplog, statement, events, sprung):
    """Each of the seven (p855)."""
    words = {'SGOpen': 'open', 'SGClose': 'close', 'Pause': 'pause', 'Abort': 'abort'}
    words['Finish'] = 'finish'
    source = f"""
    Function main
      Trap Emergency Xqt emergency_stop
      Trap Error Xqt failed
      {'; '.join(f'Trap {event} Xqt at_{word}' for event, word in words.items())}
      Motor On
      {statement}
    Fend
    Function emergency_stop
      Print "emergency", MyTask
    Fend
    Function failed(number As Integer, robot_number As Integer, axis As Integer)
      Print "error", number, robot_number, axis
    Fend
    """
    for word in words.values():
        source += f'Function at_{word}\n Print "{word}"\nFend\n'
    harness = SpelProgramHarness(source, caplog)
    harness.step(0.2)
    for event in events:
        harness.do(event)
        harness.step(0.2)
    assert harness.printed == sprung
    harness.step(1.0)
    assert harness.printed == sprung
