# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`Trap`: arming, triggering on a scan, and functions started by events."""

import pytest
from support.spel_harness import ScriptedHost, machine, run

from epson_driver.spel import Memory


def test_event_traps_start_their_functions() -> None:
    source = """
    Function main
      Trap Emergency Xqt stopped
      Trap Error Xqt failed
      Trap SGOpen Xqt door
      Trap SGOpen
      Wait 100
    Fend
    Function stopped
      Print "stopped", TaskInfo(MyTask, 2)
    Fend
    Function failed(n As Integer, robot_number As Integer, axis As Integer)
      Print "failed", n, robot_number, axis
    Fend
    Function door
      Print "door"
    Fend
    """
    host = ScriptedHost()
    made = machine(source, host)
    made.start()
    made.advance(0.1)
    made.emergency_stop()
    assert made.event('emergency')
    assert made.event('error', 4031, 1)
    assert not made.event('sgopen')
    made.advance(0.2)
    assert host.text.splitlines() == ['stopped 2', 'failed 4031 1 0']


@pytest.mark.parametrize(('action', 'expected'), [('Call', '0.5'), ('Xqt', '0.7')])
def test_trap_call_ends_the_wait_of_its_task_but_trap_xqt_does_not(
    action: str, expected: str
) -> None:
    """The task continues with the next statement after the function (p852)."""
    source = f"""
    Function main
      Trap 1, MemSw(1) = On {action} handle
      MemOn 1
      Wait 0.7
      Print Tmr(0)
    Fend
    Function handle
      Wait 0.5
    Fend
    """
    assert float(run(source).text) == pytest.approx(float(expected), abs=0.002)


def test_armed_trap_triggers_only_once() -> None:
    source = """
    Function main
      Trap 2, MemSw(1) = On Xqt sprung
      MemOn 1
      Wait 0.1
      MemOff 1
      Wait 0.1
      MemOn 1
      Wait 0.1
    Fend
    Function sprung
      Print "sprung"
    Fend
    """
    assert run(source).text == 'sprung\n'


def test_trap_without_a_target_is_disarmed() -> None:
    source = """
    Function main
      Trap 2, MemSw(1) = On Xqt sprung
      Trap 2
      MemOn 1
      Wait 0.1
      Print "over"
    Fend
    Function sprung
      Print "sprung"
    Fend
    """
    assert run(source).text == 'over\n'


def test_armed_trap_makes_the_next_scan_a_scheduled_event() -> None:
    source = """
    Function main
      Trap 1, Sw(1) = On Call sprung()
      Wait 100
    Fend
    Function sprung
      Print "sprung"
    Fend
    """
    host = ScriptedHost()
    made = machine(source, host, scan=0.01)
    made.start()
    made.advance(5.0)
    due = made.next_time()
    assert due is not None
    assert 5.0 < due <= 5.011
    host.write_bits(Memory.INPUT, 1, 1, 1)
    made.advance(due)
    assert host.text == 'sprung\n'


def test_event_trap_runs_once_at_a_time() -> None:
    source = """
    Function main
      Trap SGOpen Xqt door
      Wait 100
    Fend
    Function door
      Print "door"
      Wait 0.5
    Fend
    """
    host = ScriptedHost()
    made = machine(source, host)
    made.start()
    made.advance(0.1)
    assert made.event('sgopen')
    made.advance(0.2)
    assert not made.event('sgopen')
    made.advance(1.0)
    assert made.event('sgopen')
    made.advance(1.1)
    assert host.text == 'door\ndoor\n'


def test_trap_goto_ends_the_wait_and_the_calls() -> None:
    """The manual's example of a global variable as the event (p853)."""
    source = """
    Global Integer gi
    Function main
      Trap 1, gi = 5 GoTo handle
      Xqt sub
      inner
      Print "never"
      Exit Function
    handle:
      Print "in trap", gi, Tmr(0) < 3
    Fend
    Function inner
      Wait 100
    Fend
    Function sub
      For gi = 0 To 10
        Wait 0.5
      Next gi
    Fend
    """
    assert run(source).text == 'in trap 5 -1\n'


def test_trap_goto_is_disarmed_when_its_function_ends() -> None:
    source = """
    Function main
      armed
      MemOn 1
      Wait 0.1
      Print "over"
    Fend
    Function armed
      Trap 1, MemSw(1) = On GoTo sprung
      Exit Function
    sprung:
      Print "sprung"
    Fend
    """
    assert run(source).text == 'over\n'
