# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Messages for faulty programs: rule or error number, file, line, and remedy."""

import pytest
from support.spel_harness import files, run

from epson_driver.spel import ProgramError, build
from epson_driver.spel.lint import check

BEFORE_THE_START = {
    'unknown statement': (
        'Function main\n  Prnt 1\nFend',
        'main.prg:2:3: error: unknown statement or function Prnt: did you mean Print? [unknown]',
    ),
    'missing EndIf': (
        'Function main\n  If Sw(1) = On Then\n    Print 1\nFend',
        'main.prg:2:3: error: If of line 2 has no EndIf [syntax]',
    ),
    'wrong type': (
        'Function main\n  Integer i\n  i = "a"\nFend',
        'main.prg:3:7: error: Integer cannot take a string [type]',
    ),
}
BY_THE_LINTER = {
    'endless loop': (
        'Function main\n  Do\n    MemOn 1\n  Loop\nFend',
        'main.prg:2:3: warning: ',
        'the loop has no Wait: add a Wait of 0.01 s or more',
    ),
    'two tasks on one port': (
        'Function main\n  Xqt a\n  OpenNet #201 As Server\nFend\n'
        'Function a\n  OpenNet #201 As Server\nFend',
        'main.prg:6:3: warning: ',
        '201',
    ),
}
WHEN_IT_RUNS = {
    'endless loop': (
        'Function main\n  Integer i\n  Do\n    i = 1\n  Loop\nFend',
        'main.prg:',
        'error 2556 in main (task 1): an endless loop without a Wait: add a Wait of 0.01 s',
    ),
    'array out of range': (
        'Function main\n  Integer a(3), i\n  i = 7\n  a(i) = 1\nFend',
        'main.prg:4: ',
        'error 9992 in main (task 1): an array index is out of range: it goes from 0 to UBound',
    ),
    'division by zero': (
        'Function main\n  Integer i, z\n  i = 1 / z\nFend',
        'main.prg:3: ',
        'error 9991 in main (task 1): division by zero: check the divisor first',
    ),
    'error without a handler': (
        'Function main\n  Error 8100\nFend',
        'main.prg:2: ',
        'error 8100 in main (task 1): an error defined by the program: handle it (OnErr), or',
    ),
    'two tasks on one port': (
        'Function main\n  OpenNet #201 As Server\n  Xqt 2, a\n  Wait 1\nFend\n'
        'Function a\n  OpenNet #201 As Server\nFend',
        'main.prg:7: ',
        'error 2907 in a (task 2): OpenNet: port 201 was opened by task 1: one task opens, uses',
    ),
}


@pytest.mark.parametrize('name', BEFORE_THE_START)
def test_build_error_has_position_and_remedy(name: str) -> None:
    source, message = BEFORE_THE_START[name]
    with pytest.raises(ProgramError) as caught:
        build(files(source))
    assert str(caught.value) == message


@pytest.mark.parametrize('name', BY_THE_LINTER)
def test_linter_problem_has_position_and_remedy(name: str) -> None:
    source, where, what = BY_THE_LINTER[name]
    (problem,) = check(files(source))
    assert str(problem).startswith(where)
    assert what in str(problem)


@pytest.mark.parametrize('name', WHEN_IT_RUNS)
def test_run_time_error_has_position_and_remedy(name: str) -> None:
    source, where, what = WHEN_IT_RUNS[name]
    (failure,) = run(source, 30.0).failures
    assert str(failure).startswith(where)
    assert what in str(failure)
