# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Statements of EPSON's SPEL+ Language Reference, as programs with their output."""

from pathlib import Path
from textwrap import dedent, indent

import pytest
from support.spel_harness import on_controller

FACTS = (Path(__file__).parent / 'manual_facts.txt').read_text(encoding='utf-8')

PROGRAMS = {
    'TaskWait returns when the task ends': (
        'Function t\n  Print "t"\nFend\n'
        'Function main\n  Xqt 4, t\n  TaskWait 4\n  Print "over"\nFend',
        't|over',
    ),
    'p65 a task that has ended can be quit': (
        'Function t\n  Print "t"\nFend\n'
        'Function main\n  Xqt t\n  Wait 0.1\n  Quit t\n  Quit 7\n  Print "over"\nFend',
        't|over',
    ),
    'p690 Resume All continues halted tasks': (
        'Function t\n  Wait 0.2\n  Print "t"\nFend\n'
        'Function main\n  Xqt 2, t\n  Wait 0.1\n  Halt t\n  Wait 1\n  Print TaskState(t)\n'
        '  Resume All\n  TaskWait t\nFend',
        '3|t',
    ),
    'p758 a signal wakes waiting tasks': (
        'Function t\n  Wait 0.1\n  Signal 1\nFend\n'
        'Function main\n  Xqt t\n  WaitSig 1\n  Print "woken"\nFend',
        'woken',
    ),
    'p799 a lock is free when its task has ended': (
        'Function t\n  SyncLock 1\nFend\n'
        'Function main\n  Xqt t\n  Wait 0.1\n  SyncLock 1\n  Print "mine"\nFend',
        'mine',
    ),
}


def facts():
    for line in FACTS.splitlines():
        if line.startswith('#'):
            continue
        page, rest = line.split(' ', 1)
        body, wanted = rest.rsplit(' -> ', 1)
        text = indent(body.replace('; ', '\n'), '  ')
        yield pytest.param(f'Function main\n{text}\nFend', wanted, id=f'{page} {body}')
    for name, (source, wanted) in PROGRAMS.items():
        yield pytest.param(dedent(source), wanted, id=name)


@pytest.mark.parametrize(('source', 'wanted'), list(facts()))
def test_interpreter_prints_the_result_in_the_manual(source: str, wanted: str) -> None:
    result = on_controller(source)
    assert (result.error, '|'.join(result.printed.splitlines())) == ('', wanted)
