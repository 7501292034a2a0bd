# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""OnErr, EResume, and errors that nothing handles."""

import pytest
from support.spel_harness import ScriptedHost, printed, run

from epson_driver.spel import ErrorNumber, Memory, SpelError


def test_eresume_repeats_and_eresume_next_continues() -> None:
    body = """
    Integer i, tries
    OnErr GoTo failed
    i = 10 / tries
    Print i
    tries = 0
    i = 10 / tries
    Print "behind"
    OnErr GoTo 0
    Exit Function
    failed:
    tries = tries + 1
    If i = 0 Then EResume
    EResume Next
    """
    assert printed(body) == ['10', 'behind']


def test_error_in_a_handler_is_not_handled_by_it() -> None:
    source = """
    Function main
      OnErr GoTo failed
      Error 8001
    failed:
      Error 8002
    Fend
    """
    (failure,) = run(source).failures
    assert (failure.number, failure.position.line) == (8002, 5)


def test_error_handler_handles_only_errors_of_its_own_call() -> None:
    source = """
    Function main
      OnErr GoTo failed
      quiet
      Print "quiet"
      quiet
      Error 8003
      Exit Function
    failed:
      Print "main", Err
      EResume Next
    Fend
    Function quiet
      OnErr GoTo near
      Error 8001
      Exit Function
    near:
      EResume Next
    Fend
    """
    assert run(source).text.splitlines() == ['quiet', 'main 8003']


def test_error_statement_can_raise_in_another_task() -> None:
    source = """
    Function main
      Xqt 2, other
      Xqt 3, careful
      Wait 0.1
      Error 2, 8005
      Error 3, 8006
      Print "main continues", TaskState(2), TaskState(3)
    Fend
    Function other
      Wait 10
    Fend
    Function careful
      OnErr GoTo failed
      Wait 10
    failed:
      Print "careful", Err, Erl
    Fend
    """
    host = run(source)
    (failure,) = host.failures
    assert (failure.number, failure.task, failure.position.line) == (8005, 2, 10)
    assert host.text.splitlines() == ['main continues 5 1', 'careful 8006 14']


def test_error_in_a_wait_condition_reports_its_task_and_line() -> None:
    class Unplugged(ScriptedHost):
        looks = 0

        def read_bits(self, memory: Memory, index: int, width: int) -> int:
            self.looks += 1
            if self.looks > 3:
                raise SpelError(ErrorNumber.ARGUMENT, 'the inputs are unplugged')
            return 0

    source = """
    Function main
      OnErr GoTo failed
      Wait Sw(1) = On
      Print "never"
      Exit Function
    failed:
      Print Err, Erl
    Fend
    """
    host = run(source, host=Unplugged())
    assert host.text.splitlines() == [f'{ErrorNumber.ARGUMENT:d} 3']
    host = run('Function main\n  Wait Sw(1) = On\nFend\n', host=Unplugged())
    (failure,) = host.failures
    assert str(failure).startswith('main.prg:2: error 9993 in main (task 1): ')
    assert 'the inputs are unplugged' in failure.text


@pytest.mark.parametrize('kind', [ValueError, IndexError, ZeroDivisionError, OverflowError])
def test_exception_of_the_host_is_not_a_program_error(kind: type[Exception]) -> None:
    class Broken(ScriptedHost):
        def read_bits(self, memory: Memory, index: int, width: int) -> int:
            raise kind('a bug')

    with pytest.raises(kind, match='a bug'):
        run('Function main\n  Print Sw(1)\nFend\n', host=Broken())


def test_error_in_a_trap_condition_reports_its_line() -> None:
    source = 'Function main\n  Trap 1, Sw(-1) = On Call main\n  Wait 1\nFend\n'
    (failure,) = run(source).failures
    assert (failure.number, failure.position.line) == (ErrorNumber.ARGUMENT, 3)


@pytest.mark.parametrize(
    ('statements', 'number', 'line', 'text'),
    [
        ('i = 1 / z', ErrorNumber.DIVISION_BY_ZERO, 4, 'division by zero'),
        ('i = 1 Mod z', ErrorNumber.DIVISION_BY_ZERO, 4, 'division by zero'),
        ('i = a(i + 9)', ErrorNumber.INDEX, 4, 'array index'),
        ('i = a(z - 1)', ErrorNumber.INDEX, 4, 'index -1 is below 0'),
        ('l = 255 * &H1000000 + z', ErrorNumber.OVERFLOW, 4, '4278190080 does not fit Long'),
        ('r = Sqr(z - 1)', ErrorNumber.ARGUMENT, 4, 'Sqr: -1 is below 0'),
        ('r = (z - 8) ** 0.5', ErrorNumber.ARGUMENT, 4, 'no fractional power'),
        ('r = 10 ** 400', ErrorNumber.OVERFLOW, 4, 'does not fit Double'),
        ('i = 10 ** 300', ErrorNumber.OVERFLOW, 4, 'does not fit Integer'),
        ('i = Asc("")', ErrorNumber.ARGUMENT, 4, 'the string is empty'),
        ('Print Chr$(256)', ErrorNumber.ARGUMENT, 4, '256 is not in 1..255'),
        ('Print LShift(1, 32)', ErrorNumber.ARGUMENT, 4, 'not in 0..31'),
        ('Print Mid$("a", 0)', ErrorNumber.ARGUMENT, 4, 'Mid$: 0 is below 1'),
        ('Print Err(7)', ErrorNumber.NO_SUCH_TASK, 4, 'task 7 does not exist'),
        ('Print TaskState(999)', ErrorNumber.TASK_NUMBER, 4, 'not in 1..'),
        ('Halt 7', ErrorNumber.NO_SUCH_TASK, 4, 'task 7 does not exist'),
        ('Xqt 1, main', ErrorNumber.TASK_NUMBER, 4, 'task 1 is running'),
        ('Xqt 40, main', ErrorNumber.TASK_NUMBER, 4, 'task 40 is not in 1..32'),
        ('Wait -1', ErrorNumber.ARGUMENT, 4, 'Wait: -1 is not in 0..10000000'),
        ('Wait 1e300', ErrorNumber.ARGUMENT, 4, 'Wait: 1e+300 is not in'),
        ('Error 0', ErrorNumber.ARGUMENT, 4, 'not in 1..9999'),
        ('EResume', ErrorNumber.RESUME, 4, 'EResume without an error'),
        ('Return', ErrorNumber.RETURN_WITHOUT_GOSUB, 4, 'Return without GoSub'),
        ('Redim a(200000)', ErrorNumber.ARGUMENT, 4, 'more than 2000 elements'),
        ('Print Sw(-1)', ErrorNumber.ARGUMENT, 4, 'Sw: -1 is not in 0..32767'),
        ('Out 0, 256', ErrorNumber.ARGUMENT, 4, 'Out: 256 is not in 0..255'),
        ('Print ChkNet(5)', ErrorNumber.ARGUMENT, 4, '5 is not in 201..216'),
        ('OpenNet #300 As Server', ErrorNumber.ARGUMENT, 4, '300 is not in 201..216'),
        ('Go P5', 7007, 4, 'P5 is not defined'),
        ('Go XY(1, 2, 3, 4)', 4031, 4, 'motors off'),
        ('SyncLock 64', ErrorNumber.ARGUMENT, 4, '64 is not in 0..63'),
        ('r = Rnd(1); i = Time(5)', ErrorNumber.ARGUMENT, 4, '5 is not in 0..2'),
        ('GoSub a1\na1:\nGoSub a1', ErrorNumber.CALL_DEPTH, 6, 'nested GoSub'),
        ('Print BSet(0, 32)', ErrorNumber.ARGUMENT, 4, 'BSet: 32 is not in 0..31'),
        ('Print BTst(0, z - 1)', ErrorNumber.ARGUMENT, 4, 'BTst: -1 is not in 0..31'),
        ('Print Left$("abc", z - 1)', ErrorNumber.ARGUMENT, 4, 'Left$: -1 is not in 0..255'),
        ('Print Space$(256)', ErrorNumber.ARGUMENT, 4, 'Space$: 256 is not in 0..255'),
        ('r = Val("1e999")', ErrorNumber.OVERFLOW, 4, 'inf does not fit Double'),
        (
            'Print FmtStr$(1, "0x0")',
            ErrorNumber.ARGUMENT,
            4,
            "'0x0' must contain only 0, #, commas and at most one point",
        ),
        ('Print FmtStr$(1, "0.0.0")', ErrorNumber.ARGUMENT, 4, "'0.0.0' must contain only 0, #"),
        ('i = UBound(a(), 2)', ErrorNumber.ARGUMENT, 4, 'UBound: the array has no dimension 2'),
        ('String t$(1, 1)\nParseStr "a b", t$(), " "', ErrorNumber.ARGUMENT, 5, 'one dimension'),
        ('Print Tmr(64)', ErrorNumber.ARGUMENT, 4, 'Tmr: 64 is not in 0..63'),
        ('i = TaskInfo(9, 3)', ErrorNumber.NO_SUCH_TASK, 4, 'TaskInfo: task 9 does not exist'),
        ('i = TaskInfo(1, 5)', ErrorNumber.ARGUMENT, 4, 'TaskInfo: 5 is not in 0..4'),
        ('i = 1e308 * 10', ErrorNumber.OVERFLOW, 4, 'inf does not fit Long'),
        ('Pallet 1, JA(1, 2), JA(3, 4), JA(5, 6), 2, 2', ErrorNumber.ARGUMENT, 4, 'X, Y and Z'),
        ('P1 = JA(1, 2, 3, 4, 5, 6) +X(1)', ErrorNumber.ARGUMENT, 4, 'no coordinate X'),
        ('Error 2, 8001', ErrorNumber.NO_SUCH_TASK, 4, 'task 2 does not exist'),
        ('Error 1, 0', ErrorNumber.ARGUMENT, 4, 'Error: 0 is not in 1..9999'),
    ],
)
def test_unhandled_error_has_number_file_line_and_text(
    statements: str, number: int, line: int, text: str
) -> None:
    head = 'Function main\n  Integer i, z, a(5)\n  Long l; Double r\n'
    (failure,) = run(f'{head}{statements}\nFend\n').failures
    assert (failure.number, failure.position.line, failure.task) == (number, line, 1)
    assert text in failure.text
    assert str(failure).startswith(f'main.prg:{line}: error {number:d} in main (task 1): ')
