# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Fuzzing: any program text runs or is refused with file and line, in bounded time."""

import random
import re
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples, one_in
from support.spel_harness import SCARA, ScriptedHost

from epson_driver.sim_controller.spel_run import run_function
from epson_driver.spel import Machine, ProgramEnvironment, ProgramError, build
from epson_driver.spel.lint import check
from epson_driver.spel.words import CONSTANTS
from epson_driver.spel.words import WORDS as TABLE

WORDS = sorted([*TABLE, *list(CONSTANTS)[:60], 'p'])
SIGNS = [
    '(',
    ')',
    ',',
    ';',
    ':',
    '=',
    '+',
    '-',
    '*',
    '/',
    '**',
    '<',
    '>',
    '#',
    '!',
    '"',
    "'",
    '\n',
]
PIECES = [
    *WORDS,
    *SIGNS * 4,
    '\n',
    '\n',
    'a',
    'b',
    'main',
    's$',
    'P1',
    '0',
    '1',
    '2.5',
    '&HFF',
    '201',
]
PROBLEM = re.compile(r'[^\n]*main\.prg:\d+:\d+: error: [^\n]+ \[[a-z-]+\]')


def build_and_run(text: str) -> str:
    """Check, build and run a program. Return 'refused' or 'run'."""
    check({'main.prg': text})
    try:
        program = build({'main.prg': text})
    except ProgramError as error:
        for line in str(error).split('\n'):
            assert PROBLEM.fullmatch(line) or re.fullmatch(r'and \d+ more', line), line
        return 'refused'
    host = ScriptedHost()
    host.typed = ['1, 2', 'x'] * 3
    host.motors = True
    machine = Machine(program, host)
    for number, code in enumerate(program.functions[:3], 1):
        if not code.parameters:
            machine.start(code.name, number)
    for step in range(5):
        machine.advance(step * 0.02)
        assert machine.statements <= 5 * (0.02 + 0.001) / 10e-6 + 10_000
    for failure in host.failures:
        assert re.match(r'main\.prg:\d+: error \d+ in \w+ \(task \d+\): .', str(failure))
    for code in program.functions[:3]:
        if not code.parameters:
            error = run_function(program, code, SCARA, ProgramEnvironment(), max_time=0.1).error
            assert re.match(r'(error \d+: .|still running after |waits for |$)', error)
    return 'run'


@settings(max_examples=examples(300))
@given(st.lists(st.sampled_from(PIECES), max_size=40))
def test_random_words_run_or_are_refused(pieces: list[str]) -> None:
    text = ' '.join(pieces)
    build_and_run(text)
    build_and_run(f'Global Integer a, b(3)\nFunction main\n{text}\nFend\n')


GOOD = """#define LAST 3
Global Integer g_n
Global Preserve Double g_d(20)
Function main
  Integer i, k(LAST)
  String s$
  OnErr GoTo failed
  For i = 0 To LAST
    k(i) = i * i + LShift(1, i)
    s$ = s$ + Str$(k(i))
  Next i
  Xqt 2, worker(k(2), s$), NoPause
  Do While g_n < 5
    Select g_n
      Case 1, 2
        g_d(g_n) = 1 / g_n
      Case > 3
        Print s$, g_d(2)
      Default
        If g_n = 0 And i > 2 Then Print "zero" Else Print g_n; Wait 0.01
    Send
    Wait g_n > i Or MemSw(3) = On, 0.02
  Loop
  Motor On; Go XY(1, 2, 3, 4) +Z(10) CP Till Sw(1) = On
  SetNet #201, "a", 2000, CRLF, NONE, 0
  OpenNet #201 As Server
  WaitNet #201, 0.1
  Exit Function
failed:
  Print Err, Erl, ErrMsg$(Err)
  EResume Next
Fend
Function worker(n As Integer, s$ As String)
  Do
    g_n = g_n + 1
    SyncLock 1; Wait 0.01; SyncUnlock 1
    change(ByRef g_n, 1)
  Loop Until g_n > n
Fend
Function change(ByRef n As Integer, m As Integer) As Long
  n = n + m
  change = n
Fend
"""


def test_valid_program_runs() -> None:
    assert build_and_run(GOOD) == 'run'


@settings(max_examples=examples(300))
@given(st.integers(0, 2**32), st.integers(1, 6))
def test_mutated_program_runs_or_is_refused(seed: int, changes: int) -> None:
    chance = random.Random(seed)
    words = re.findall(r'\s+|\w+\$?|.', GOOD)
    for _ in range(changes):
        at = chance.randrange(len(words))
        kind = chance.randrange(4)
        if kind == 0:
            del words[at]
        elif kind == 1:
            words.insert(at, words[chance.randrange(len(words))])
        elif kind == 2:
            words[at] = chance.choice(PIECES)
        else:
            other = chance.randrange(len(words))
            words[at], words[other] = words[other], words[at]
    build_and_run(''.join(words))


@pytest.mark.parametrize(
    'text',
    [
        'Function main\n' + 'If 1 Then ' * 300 + '\nFend',
        'Function main\n' + 'Not ' * 300 + '\nFend',
        'Function main\nPrint ' + '-' * 1000 + '1\nFend',
        'Function main\nPrint ' + 'Abs(' * 200 + '1' + ')' * 200 + '\nFend',
        'Function main\nPrint ' + 'Abs(' * 39 + '1' + ')' * 39 + '\nFend',
        'Function main\nPrint ' + '(1 + ' * 39 + '1' + ')' * 39 + '\nFend',
        'Function main\nPrint ' + 'Not ' * 39 + '1\nFend',
        'Function main\nPrint ' + '1 = ' * 99 + '1\nFend',
        'Function main\nPrint ' + '9 ** ' * 20 + '9\nFend',
        'Function main\n' + 'If 1 Then\n' * 29 + 'EndIf\n' * 29 + 'Fend',
        'Function main\nPrint 9' + ' * 99999999999999' * 90 + '\nFend',
        'Function main\n Double d\n d = 9' + ' * 99999999999999' * 90 + '\nFend',
        'Integer a(99999)\n' * 300 + 'Function main\nFend',
        '\n'.join(f'Integer a{i}(99999)' for i in range(300)) + '\nFunction main\nFend',
        'Function main\n Integer a(' + '9' * 30 + ')\nFend',
        'Function ' + 'x' * 4000 + '\nFend',
        'Function main\nGo P1' + ' +X(1)' * 200 + '\nFend',
        'Function main\nmain\nFend',
        'Function main\nDo\nLoop\nFend',
        'Function main\nDo\nPrint 1\nLoop\nFend',
        'Function main\nXqt main\nmain\nFend',
        '\x00\x01Function main\nFend\x1a',
    ],
)  # fmt: skip
def test_unbounded_program_is_stopped(text: str) -> None:
    build_and_run(text)


@pytest.mark.slow
@pytest.mark.parametrize(
    'text',
    one_in(
        2,
        [
            'Select 1\n' + 'Case 1\n' * 1_500 + 'Send',
            'Pass P(0:999), P(999:0)\n' * 8,
        ],
    ),
    ids=['cases', 'points'],
)
def test_long_function_uses_little_memory(text: str) -> None:
    tracemalloc.start()
    try:
        Machine(build({'main.prg': f'Function main\n{text}\nFend'}), ScriptedHost())
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()
