# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Scheduling of tasks: times, waits, stops, locks and reproducibility."""

import pytest
from support.spel_harness import ScriptedHost, machine, run

from epson_driver.spel import (
    ErrorNumber,
    Machine,
    Memory,
    SpelError,
    TaskState,
    TaskType,
)

COUNTING = """
Global Long g_a, g_b
Function main
  Xqt 2, count_b
  Do
    g_a = g_a + 1
  Loop
Fend
Function count_b
  Do
    g_b = g_b + 1
  Loop
Fend
"""


def test_tasks_run_no_longer_than_the_given_time() -> None:
    made = machine(COUNTING)
    made.start()
    made.advance(0.0)
    before = made.statements
    made.advance(0.0)
    assert made.statements == before
    made.advance(0.1)
    assert made.statements == pytest.approx(0.1 / 10e-6, rel=0.03)
    assert made.time == pytest.approx(0.1, abs=0.0011)


def test_tasks_share_the_processor_equally() -> None:
    made = machine(COUNTING)
    made.start()
    made.advance(1.0)
    (a, b) = made.world.g
    assert isinstance(a, int)
    assert isinstance(b, int)
    assert abs(a - b) <= 100
    assert a + b == pytest.approx(made.statements / 2, abs=100)


@pytest.mark.parametrize('statement', [5e-6, 20e-6])
def test_statement_takes_the_configured_time(statement: float) -> None:
    source = """
    Function main
      Integer i
      For i = 1 To 1000
      Next
      Print Tmr(0)
    Fend
    """
    host = ScriptedHost()
    made = machine(source, host, statement=statement)
    made.start()
    made.advance(1.0)
    assert float(host.text) == pytest.approx(2000 * statement, abs=0.0011)


def test_wait_is_rounded_up_to_ticks_from_its_statement() -> None:
    source = """
    Function main
      Wait 0.001
      Print Tmr(0)
      Wait 0.02
      Print Tmr(0)
      Wait 0
      Print Tmr(0)
    Fend
    """
    assert run(source).text.split() == ['0.01', '0.03', '0.03']


def test_task_resumes_when_the_host_has_input() -> None:
    host = ScriptedHost()
    made = machine('Function main\n  Integer i\n  Input i\n  Print i\nFend\n', host)
    made.start()
    made.advance(100.0)
    host.typed.append('7')
    made.advance(100.0)
    assert host.text == '7\n'


def test_conditions_are_evaluated_on_scans_only() -> None:
    """A value that holds for less than a scan may be missed, according to the manual."""
    source = """
    Global Integer g_n
    Function main
      Xqt 2, blink
      Wait g_n = 1, 0.5
      Print TW
      Wait g_n = 2, 0.5
      Print TW
    Fend
    Function blink
      Wait 0.1
      g_n = 1; g_n = 2
    Fend
    """
    assert run(source).text.split() == ['-1', '0']


LIVES = """
Function bgmain
  Xqt g_child
  forever
Fend
Function g_child
  forever
Fend
Function main
  Xqt 2, forever, NoPause
  Xqt 3, forever, NoEmgAbort
  forever
Fend
Function forever
  Do
    Wait 0.01
  Loop
Fend
"""


def living(made: Machine) -> dict[int, TaskType]:
    return {view.number: view.type for view in made.tasks()}


def test_stop_commands_end_the_right_tasks() -> None:
    made = machine(LIVES)
    made.start_background()
    made.start(clear=False)
    made.advance(0.1)
    assert living(made) == {
        1: TaskType.NORMAL,
        2: TaskType.NO_PAUSE,
        3: TaskType.NO_EMG_ABORT,
        65: TaskType.BACKGROUND,
        66: TaskType.BACKGROUND,
    }
    made.pause()
    states = {view.number: view.state for view in made.tasks()}
    assert [states[1], states[2], states[3], states[65]] == [
        TaskState.HALTED,
        TaskState.WAITING,
        TaskState.WAITING,
        TaskState.WAITING,
    ]
    made.resume()
    made.emergency_stop()
    assert list(living(made)) == [3, 65, 66]
    made.stop()
    assert list(living(made)) == [65, 66]


def test_wait_restarts_after_a_pause() -> None:
    source = 'Function main\n  Wait 1\n  Print Tmr(0)\nFend\n'
    host = ScriptedHost()
    made = machine(source, host)
    made.start()
    made.advance(0.9)
    made.pause()
    made.advance(5.0)
    assert host.text == ''
    made.resume()
    made.advance(5.9)
    assert host.text == ''
    made.advance(6.1)
    assert host.text == '6\n'


@pytest.mark.parametrize(
    ('statement', 'refused_by'),
    [
        ('Motor On', {'NoEmgAbort', 'background'}),
        ('Go XY(0, 0, 0, 0)', {'NoEmgAbort', 'background'}),
        ('Speed 50', {'NoEmgAbort', 'background'}),
        ('Reset', {'NoEmgAbort', 'background'}),
        ('Reset Error', set()),
        ('Xqt nothing', {'NoEmgAbort'}),
        ('StartMain other', {'Normal', 'NoPause', 'NoEmgAbort'}),
        ('AbortMotion All', set()),
        ('On 1', set()),
        ('Till Sw(1) = On', {'NoEmgAbort', 'background'}),
        ('Trap 1, Sw(1) = On Call nothing', {'NoEmgAbort', 'background'}),
    ],
)
def test_statement_is_refused_by_task_type(statement: str, refused_by: set[str]) -> None:
    source = f"""
    Function main
    Fend
    Function other
    Fend
    Function nothing
    Fend
    Function act
      {statement}
    Fend
    Function bgmain
      Xqt act
    Fend
    Function start_NoPause
      Xqt act, NoPause
    Fend
    Function start_NoEmgAbort
      Xqt act, NoEmgAbort
    Fend
    Function start_Normal
      Xqt act, Normal
    Fend
    """
    result = set()
    for kind in ('Normal', 'NoPause', 'NoEmgAbort', 'background'):
        host = ScriptedHost()
        host.motors = True
        made = machine(source, host)
        if kind == 'background':
            made.start_background()
        else:
            made.start(f'start_{kind}', 9)
        made.advance(1.0)
        if host.failures:
            assert [failure.number for failure in host.failures] == [ErrorNumber.TASK_TYPE]
            result.add(kind)
    assert result == refused_by


def test_background_task_restarts_main() -> None:
    source = """
    Function bgmain
      Do
        If TaskState(main) = 0 Then StartMain main
        Wait 0.1
      Loop
    Fend
    Function main
      Print MyTask
      Wait 0.15
    Fend
    """
    host = ScriptedHost()
    made = machine(source, host)
    made.start_background()
    made.advance(1.0)
    assert host.text.split() == ['1'] * 5


def test_locks_are_first_come_first_served_and_released_at_task_end() -> None:
    source = """
    Function main
      Xqt 2, worker(1)
      Xqt 3, worker(2)
      Xqt 4, worker(3)
    Fend
    Function worker(n As Integer)
      SyncLock 5
      Print n, "in"
      Wait 0.1
      Print n, "out"
      If n = 1 Then SyncUnlock 5
    Fend
    """
    lines = run(source).text.splitlines()
    assert lines == ['1 in', '1 out', '2 in', '2 out', '3 in', '3 out']


def test_lock_timeout_sets_tw() -> None:
    source = """
    Function main
      Xqt 2, holder
      Wait 0.1
      SyncLock 5, 0.2
      Print TW
      OnErr GoTo failed
      SyncUnlock 5
      Exit Function
    failed:
      Print Err
    Fend
    Function holder
      SyncLock 5
      Wait 5
    Fend
    """
    assert run(source).text.split() == ['-1', f'{ErrorNumber.SYNC:d}']


@pytest.mark.parametrize(
    ('condition', 'expected'),
    [
        ('Sw(1), 5', '0 0.2'),  # a state that holds from 0.2 s on
        ('Not Sw(1), 0.1', '0 0'),
        ('EStopOn, 0.1', '-1 0.1'),
        ('Val("0.3")', '0 0.3'),  # a number: how long
        ('n_tenths * 0.1', '0 0.4'),
    ],
)
def test_wait_accepts_conditions_and_times(condition: str, expected: str) -> None:
    source = f"""
    Integer n_tenths
    Function main
      n_tenths = 4
      TmReset 0
      Wait {condition}
      Print TW, FmtStr$(Tmr(0), "0.0#")
    Fend
    """
    host = ScriptedHost()
    made = machine(source, host)
    made.start()
    made.advance(0.19)
    host.write_bits(Memory.INPUT, 1, 1, 1)
    made.advance(10.0)
    waited, seconds = expected.split()
    assert host.text.split()[0] == waited
    assert float(host.text.split()[1]) == pytest.approx(float(seconds), abs=0.011)


def test_motion_blocks_its_task_until_the_host_reports_its_end() -> None:
    source = """
    Function main
      Motor On
      Print "motors"
      OnErr GoTo failed
      Go XY(1, 2, 3, 4) CP Till MemSw(1) = On
      Print "there"
      Go XY(2, 2, 3, 4)
      Print "never"
      Exit Function
    failed:
      Print Err, Erl
    Fend
    """
    host = ScriptedHost()
    host.slow = True
    made = machine(source, host)
    made.start()
    made.advance(1.0)
    assert host.text == ''
    host.running.pop().done = True
    made.advance(1.0)
    assert host.text == 'motors\n'
    assert made.next_time() is None
    motion = host.running.pop()
    assert motion.request is not None
    assert motion.request.cp
    assert motion.request.points[0].values == (1.0, 2.0, 3.0, 4.0, 0.0, 0.0)
    assert motion.request.till is not None
    assert not motion.request.till()
    made.world.host.write_bits(Memory.MEMORY, 1, 1, 1)
    assert motion.request.till()
    motion.done = True
    made.advance(1.0)
    assert host.text == 'motors\n'  # the machine is some statements ahead of this time
    due = made.next_time()
    assert due is not None
    assert 1.0 < due < 1.001
    made.advance(due)
    assert host.text == 'motors\nthere\n'
    motion = host.running.pop()
    motion.error, motion.done = SpelError(2999), True
    made.advance(1.1)
    assert host.text == 'motors\nthere\n2999 7\n'
    assert not list(made.tasks())


def test_endless_loop_without_wait_is_an_error() -> None:
    source = 'Function main\n  Integer i\n  Do\n    i = 1 - i\n  Loop\nFend\n'
    (failure,) = run(source, 20.0).failures
    assert failure.number == ErrorNumber.ENDLESS_LOOP
    assert failure.position.line in (3, 4)
    assert 'add a Wait of 0.01 s or more' in str(failure)


def test_result_does_not_depend_on_the_time_steps() -> None:
    source = """
    Global Long g_n
    Function main
      Integer i
      For i = 2 To 6
        Xqt i, worker(i)
      Next
      Wait g_n > 40, 5
      Print g_n, TW, Tmr(0), Rnd(1)
    Fend
    Function worker(n As Integer)
      Integer i
      For i = 1 To 10
        g_n = g_n + 1
        Print n, i, g_n, Tmr(0)
        If n Mod 2 = 0 Then Wait n * 0.01
      Next
    Fend
    """
    texts = []
    for steps in (1, 1, 7):
        host = ScriptedHost()
        made = machine(source, host)
        made.start()
        for step in range(steps):
            made.advance(2.0 * (step + 1) / steps)
        texts.append(host.text)
        assert made.time == 2.0
    assert texts[0].count('\n') == 51
    assert texts[0] == texts[1] == texts[2]


def test_tasks_report_their_state_and_line() -> None:
    source = """
    Function main
      Xqt 2, dies
      Wait 5
    Fend
    Function dies
      Error 8001
    Fend
    """
    made = machine(source)
    made.start()
    made.advance(0.1)
    first, second = made.tasks()
    assert (first.function, first.state, first.file, first.line) == (
        'main',
        TaskState.WAITING,
        'main.prg',
        3,
    )
    assert (second.number, second.state, second.line) == (2, TaskState.ABORTED, 6)
    made.clear_errors()
    assert [view.number for view in made.tasks()] == [1]
    assert made.lines()['main.prg'] == {2: True, 3: True, 4: False, 6: True, 7: False}
