# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The linter's rules: their positions, and valid programs without problems."""

import sys

import pytest
from support.spel_harness import files

from epson_driver.spel import build
from epson_driver.spel.lint import RULES, check
from epson_driver.spel.preprocess import line_tokens


def found(source: str, version: int = 8) -> list[tuple[str, int]]:
    """Return rule and line of each problem."""
    given = {'main.prg': source}
    return [(item.rule, item.position.line) for item in check(given, version)]


def main(body: str, declarations: str = '') -> str:
    return f'{declarations}\nFunction main\n{body}\nFend\n'


SHARED_PORT = """Function main
  Xqt a
  OpenNet #201 As Server
Fend
Function a
  OpenNet #201 As Server
Fend
"""
HANDED_OVER = """Global Integer g
Function main
  Wait g = 1, 2
  f(ByRef g)
Fend
Function f(ByRef n As Integer)
Fend
"""
QUITS_ANOTHER = main('  OnErr GoTo bad\n  Quit other\nbad:\n  EResume Next')
QUITS_ANOTHER += 'Function other\nFend\n'
BAD = [
    ('line-length', 3, main('  Print 1 \' ' + 'x' * 510)),
    ('name-length', 3, main('  Integer ' + 'x' * 33)),
    ('name-length', 3, main('x' * 33 + ':')),
    ('name-length', 1, f'Function {"f" * 65}\nFend'),
    ('task-type', 5, 'Function BgMain\n  act\nFend\nFunction act\n  Motor On\nFend'),
    ('task-type', 5, 'Function main\n  Xqt act, NoEmgAbort\nFend\nFunction act\n  Go P1\nFend'),
    ('task-type', 5, 'Function BgMain\n  Xqt act\nFend\nFunction act\n  Reset\nFend'),
    ('task-type', 5, 'Function main\n  Xqt a, NoEmgAbort\nFend\nFunction a\n  Xqt main\nFend'),
    ('task-type', 5, 'Function main\n  Trap Emergency Xqt a\nFend\nFunction a\n  Speed 5\nFend'),
    ('endless-loop', 3, main('  Do\n    MemOn 1\n  Loop')),
    ('endless-loop', 3, main('  Do While Sw(1) = Off\n    MemOn 1\n  Loop')),
    ('goto-out-of-loop', 4, main('  Do\n    If Sw(1) Then GoTo away\n    Wait 1\n  Loop\naway:')),
    ('handler', 5, main('  OnErr GoTo bad\n  Print 1\nbad:\n  EResume Next')),
    ('handler', 5, QUITS_ANOTHER),
    ('handler', 5, main('  OnErr GoTo bad\n  Quit 2\nbad:\n  EResume Next')),
    ('wait-by-reference', 4, HANDED_OVER),
    ('true-compare', 4, main('  Integer i\n  If i = True Then Print 1')),
    ('true-compare', 3, main('  If Sw(1) = True Then Print 1')),
    ('and-guard', 4, main('  Integer i, a(3)\n  If i < 4 And a(i) = 1 Then Print 1')),
    ('real-to-integer', 5, main('  Integer i\n  Double d\n  i = d / 2')),
    ('integer-range', 5, main('  Integer i\n  Long l\n  i = l')),
    ('integer-range', 4, main('  Integer i\n  For i = 1 To 32767\n  Next')),
    ('declaration-in-loop', 4, main('  Do\n    Integer i\n    Wait 1\n  Loop')),
    ('range', 3, main('  Speed 120')),
    ('range', 3, main('  Accel 0, 100')),
    ('range', 3, main('  SpeedS 0')),
    ('range', 3, main('  Print Sw(-1)')),
    ('range', 3, main('  Print 5 / 0')),
    ('range', 3, main('  TmReset 99')),
    ('range', 3, main('  SetNet #300, "", 1')),
    ('range', 3, main('  MemOn 5000')),
    ('range', 3, main('  Jump P1 C9')),
    ('range', 3, main('  Tool 20')),
    ('range', 3, 'Function main\n  Wait 1\n  Xqt 40, a\nFend\nFunction a\nFend'),
    ('array-index', 4, main('  Integer a(5)\n  a(9) = 1')),
    ('unreachable', 4, main('  Exit Function\n  Print 1')),
    ('unreachable', 6, main('  Do While True\n    Wait 1\n  Loop\n  Print 1')),
    ('unreachable', 6, main('  Select MemSw(1)\n  Case 1\n    Print 1\n  Case 1\n  Send')),
    ('portable', 3, main('  Do While Sw(1) = On\n    Wait 1\n  Loop Until Sw(2) = On')),
    ('portable', 4, main('  Integer a(2)\n  For a(1) = 1 To 2\n    Wait 1\n  Next')),
    ('portable', 3, main('  Go P1 ROT')),
    ('portable', 3, main('  Pass P1 CP')),  # p604
    ('portable', 3, main('  Move P1 C0')),  # p549
    ('portable', 3, main('  Go P1 Till Sw(1) = On Find Sw(2) = On')),  # p353
    ('portable', 3, main('  Jump P1, LimZ -10')),  # p471
    ('portable', 3, main('  Go P1 LJM, 1')),  # p353
    ('portable', 3, main('  Go Here :Z(0) !D10; MemOn 1!')),  # p57
    ('portable', 3, main('  Go P1 !Speed 5!')),  # p55
    ('portable', 3, main('  Wait Sw(1) = On And Not Sw(2) = On')),
    ('portable', 3, main('  Motor 1')),  # p549
    ('portable', 3, main('  If (In(0) Mask 3) = 1 Then Print 1')),  # p527
    ('portable', 3, main('  PLocal P1, 2')),  # p634
    ('portable', 5, main('  If Sw(1) = On Then\n    Print 1\n  Else Print 2\n  EndIf')),  # p419
    ('portable', 4, main('  Select Sw(1)\n  Default Print 2\n  Send')),  # p714
    ('portable', 3, main('  WOpen "a" As 30')),  # p892
    ('portable', 3, main('  Trap 1, Sw(1) = On Call f()') + 'Function f\nFend\n'),  # p851
    ('portable', 1, 'Declare f, "a.dll"\n' + main('  Print f')),  # p278
    ('portable', 4, main('  Select MemSw(1)\n  Case 1, 2\n    Print 1\n  Send')),
    ('unused', 3, main('  Integer i')),
    ('unused', 5, main('  Print 1') + 'Function nobody\nFend\n'),
    ('unused', 1, 'Integer m\n' + main('  Print 1')),
    ('two-owners', 6, 'Function main\n  Xqt a\n  Go P1\nFend\nFunction a\n  Go P2\nFend'),
    ('two-owners', 6, 'Function main\n  Xqt a\n  TmReset 1\nFend\nFunction a\n  TmReset 1\nFend'),
    ('hex', 4, main('  Int64 l\n  l = &HFFFFFFFF')),
    ('reserved', 3, main('  Integer below')),
    ('for-depth', 14, main('  Integer i\n' + '  For i = 1 To 2\n' * 11 + '  Next\n' * 11)),
    ('port-shared', 6, SHARED_PORT),
    ('version', 3, main('  UByte b')),
    ('version', 3, main('  SpeedFactor 50')),
    ('version', 3, main('  Print ElapsedTime')),
    ('version', 1, 'Function main As Int64\nFend'),
    ('version', 1, 'Function f(a As UShort)\nFend'),
    ('unknown', 3, main('  Foo 1')),
    ('not-simulated', 3, main('  Arch 1')),  # p110
    ('not-simulated', 3, main('  SetNet')),  # p726
    ('not-simulated', 3, main('  Print ProjectName$')),  # p647
    ('not-simulated', 3, main('  Curve "a", O, 0, 4, P1, P2, On 2, P(3:7)')),  # p268
    ('not-simulated', 3, main('  CVMove "a" CP Till Sw(1) = On !D10; On 1; Wait 0.1; Off 1!')),
    ('not-simulated', 3, main('  Box 1, 1, -200, 300, 0, 500, -100, 0, On /LOCAL1')),  # p169
    ('not-simulated', 3, main('  Wait GetRobotInsideBox(1) = 0, 5')),  # p349
    ('type', 3, main('  Print 1 + "a"')),
    ('portable', 4, main('  Long n(3)\n  f(ByRef n(1))') + 'Function f(ByRef n As Long)\nFend\n'),
    ('arguments', 3, main('  Print Sin(1, 2)')),
    ('declaration', 3, main('  Integer a, a')),
    ('array-size', 3, main('  Integer a(5000)')),
    ('array-index', 4, main('  Integer a(5)\n  a(-1) = 2')),
    ('overflow', 4, main('  Integer i\n  i = 40000')),
    ('string-length', 3, main('  Print "' + 'x' * 256 + '"')),
    ('label', 3, main('  GoTo nowhere')),
    ('wait-condition', 4, main('  Integer i\n  Wait i = 1')),
    ('wait-condition', 3, main('  Wait g(1) = 1', 'Global Integer g(3)')),
    ('wait-condition', 3, main('  Wait g = 1, 2', 'Global Real g')),
    ('wait-condition', 4, main('  Integer i\n  Till i = 1')),
    ('arguments', 3, main('  Till Sw() = On')),
    ('wait-condition', 4, main('  Integer i\n  Trap 1, i = 1 Call main')),
    ('preprocessor', 1, '#endif\nFunction main\nFend'),
    ('include', 1, '#include "no.inc"\nFunction main\nFend'),
    ('include', 3, main('#include "no.inc"')),  # p62
    ('syntax', 3, main('  If 1 Then\n')),
]  # fmt: skip


@pytest.mark.parametrize(('rule', 'line', 'source'), BAD)
def test_rule_finds_its_problem_at_the_line(rule: str, line: int, source: str) -> None:
    problems = found(source, 6)
    assert (rule, line) in problems
    assert {item for item, _ in problems} - {rule} <= {'version', 'unused'}


def test_more_than_64_variables_in_wait_conditions_are_a_problem() -> None:
    names = [f'g_{number}' for number in range(65)]
    declared = '\n'.join(f'Global Integer {name}' for name in names)
    waits = '\n'.join(f'  Wait {name} = 1, 1' for name in names)
    assert [rule for rule, _ in found(main(waits, declared))] == ['wait-variables']
    assert found(main(waits.rsplit('\n', 1)[0], declared)) == []


def test_invalid_user_errors_file_is_a_problem() -> None:
    given = files('Function main\nFend\n')
    given['UserErrors.dat'] = 'Label1 {\nnError=many\n}\n'
    problem, _ = check(given)
    assert (problem.rule, problem.position.file) == ('project-file', 'UserErrors.dat')


def test_every_rule_has_a_violating_program() -> None:
    elsewhere = {'wait-variables', 'project-file'}
    assert {rule for rule, _, _ in BAD} | elsewhere == RULES.keys()


def test_problem_has_line_and_column() -> None:
    (problem,) = check(files('Function main\n  Integer i\n  If i = True Then Print 1\nFend\n'))
    assert str(problem) == (
        'main.prg:3:8: warning: i = True holds for any value but 0 (p420), or for -1 (p995): '
        'write i <> 0, or = On [true-compare]'
    )


NAMES_ONLY = """
Function BgMain
  If TaskState(main) = 1 And TaskDone(main) = 0 Then Quit main
Fend
Function main
  Motor On
Fend
"""


def test_named_task_is_not_treated_as_called() -> None:
    """TaskState(main) and Quit main in a background task: only main moves."""
    assert found(NAMES_ONLY, 6) == []


@pytest.mark.parametrize(
    'source',
    [
        main('  OnErr GoTo bad\n  Quit All\nbad:\n  EResume Next'),
        main('  OpenNet #201 As Server\n  Do\n    Print #201, "alive"\n  Loop'),
    ],
    ids=['Quit All ends this task', 'Print # waits for its port'],
)
def test_statement_that_waits_or_ends_the_task_has_no_warning(source: str) -> None:
    assert found(source) == []


GOOD = """
Global Integer g_run
Function main
  Integer i, n
  Long l
  Double d
  Boolean ready
  OnErr GoTo failed
  Xqt server, NoEmgAbort
  i = Int(d * 2)
  l = i
  ready = Sw(1) = On
  If ready = True Then Print "ready"
  If EStopOn = True Then Print "stopped"
  Do While i < 3
    i = i + 1
  Loop
  Do
    Wait 0.01
    i = i + 1
    If i > 5 Then Exit Do
  Loop
  Do
    waits
  Loop While g_run = 1
  Motor On
  Go XY(1, 2, 3, 4)
  GoTo done
again:
  n = n + 1
done:
  Exit Function
failed:
  Print Err
  EResume Next
Fend
Function waits
  Wait 0.1
Fend
Function server
  OpenNet #201 As Server
  Do
    WaitNet #201, 1
  Loop
Fend
"""


@pytest.mark.parametrize('version', [6, 7, 8])
def test_valid_program_has_no_lint_problem_in_any_version(version: int) -> None:
    build(files(GOOD))
    assert found(GOOD, version) == []


QUIET = {
    'a loop without an end above a handler': main(
        '  OnErr GoTo bad\n  Do While True\n    Wait 1\n  Loop\nbad:\n  EResume Next'
    ),
    'both branches leave above a handler': main(
        '  OnErr GoTo bad\n  If Sw(1) Then\n    Exit Function\n  Else\n    Exit Function\n'
        '  EndIf\nbad:\n  EResume Next'
    ),
    'an index that another rule has checked': main(
        '  Integer i, a(9)\n  i = a(1)\n  If i <> 3 And a(i) = 1 Then Print i'
    ),
    'a comment that switches a rule off': main("  Integer i  ' check off: hex, unused"),
    'background tasks': 'Function BgMain\n  Xqt 66, a\nFend\nFunction a\n  Wait 1\nFend\n',
    'a port of two alternative programs': (
        main('  OpenNet #201 As Server') + 'Function main1\n  OpenNet #201 As Server\nFend\n'
    ),
    'a handler directly after OnErr': main(
        '  OnErr GoTo again\nagain:\n  Print 1\n  OpenNet #201 As Client\n  WaitNet #201'
    ),
    'a handler that does nothing without an error': main(
        '  Integer n\n  OnErr GoTo bad\n  Print 1\nbad:\n  n = Err\n  If n > 0 Then EResume Next'
    ),
    'the parameters of Jump3 and Jump3CP (p476)': main(
        '  Jump3 P1, P2, P3, C0, CP, LJM, 1, Till Sw(1) = On\n  Jump3CP P1, P2, P3, LJM, !On 1!'
    ),
    'the name of a file with As': main('  WOpen "saved as a" As #30\n  Close #30'),
    'Mask in a Wait after an If (p527)': main('  If Sw(1) = On Then Wait In(0) Mask 3 = 1'),
    'Else in an If of one line (p419)': main('  If Sw(1) = On Then On 1 Else Off 1'),
    'a loop that moves': main('  Do While Sw(1) = Off\n    Home\n  Loop'),
    'a name behind an #ifdef': 'Integer m\n#ifdef X\n#define Y m\n#endif\n' + main('  Print 1'),
    'Error with a handler that continues': main(
        '  OnErr GoTo bad\n  Error 8001\n  Exit Function\nbad:\n  EResume Next'
    ),
}


@pytest.mark.parametrize('source', QUIET.values(), ids=QUIET.keys())
def test_valid_program_has_no_problems(source: str) -> None:
    assert found(source, 7) == []


def test_comment_does_not_suppress_an_error() -> None:
    assert found(main("  Speed 120 ' check off: range")) == [('range', 3)]


def _large_program(functions: int) -> str:
    """Return a program in which each function has arrays, a loop, and a call of the next one."""
    body = (
        '  Integer i\n  For i = 0 To 9\n    m{0}(i) = i\n    If Sw(i) = On Then Wait 1\n  Next\n'
    )
    every = ''.join(
        f'Integer m{number}(9)\nFunction {"main" if number == 0 else f"f{number}"}\n'
        f'{body.format(number)}\n  f{(number + 1) % functions}\nFend\n'
        for number in range(functions)
    )
    return every.replace('  f0\n', '')


def _calls(functions: int) -> int:
    """Return the number of function calls that a check of such a program makes."""
    given = {'main.prg': _large_program(functions)}
    line_tokens.cache_clear()
    count = 0

    def event(_frame: object, kind: str, _what: object) -> None:
        nonlocal count
        count += kind in ('call', 'c_call')

    sys.setprofile(event)
    try:
        assert [problem for problem in check(given) if not problem.warning] == []
    finally:
        sys.setprofile(None)
    return count


def test_check_is_linear_in_the_number_of_functions() -> None:
    _calls(10)  # fills caches
    assert _calls(80) < 2.05 * _calls(40)
