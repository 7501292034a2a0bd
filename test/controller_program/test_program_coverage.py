# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""controller_program/: every statement is executed by the tests, and its names are its own."""

import inspect
import re
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import pytest
import test_conditions
import test_io_server
import test_motion_server
import test_state_server
from support.examples import one_in
from support.robot_program import (
    FILES,
    IO_PORT,
    MOTION_PORT,
    STATE_PORT,
    RobotHarness,
    changed,
    executed_lines,
)

from epson_driver.spel import build
from epson_driver.spel.commands import COMMANDS, NOT_SIMULATED, STRUCTURE_WORDS, TYPES
from epson_driver.spel.functions import CONSTANTS, FUNCTIONS
from epson_driver.spel.functions import NOT_SIMULATED as OTHER_FUNCTIONS
from epson_driver.spel.lint import check, walk
from epson_driver.spel.syntax import Declaration, Function, Label

PORTS = {
    test_state_server: STATE_PORT,
    test_motion_server: MOTION_PORT,
    test_io_server: IO_PORT,
    test_conditions: MOTION_PORT,
}
ENDLESS = {'io.prg', 'main.prg', 'motion.prg', 'state.prg'}
BEHIND_A_LOOP = 'Fend'
"""Tasks never end: the Fend of their functions is not reached."""
PAGE = Path(__file__).parents[2] / 'docs' / 'controller_program.md'
"""It reports how many lines there are, and how many of them nothing gets to."""
LINES_OF_BYTES = 'bytes.prg'
"""test_bytes.py sees to it."""


def _parameters(test: Callable[..., None]) -> Iterator[dict[str, object]]:
    """Yield what pytest gives to a test, besides the fixtures."""
    marks = [mark.args for mark in getattr(test, 'pytestmark', []) if mark.name == 'parametrize']
    for values in product(*(values for _, values in marks)):
        yield dict(zip((name for name, _ in marks), values, strict=True))


def _run(test: Callable[..., None], port: int, given: dict[str, object]) -> None:
    names = inspect.signature(test).parameters
    if 'harness' in names:
        given['harness'] = harness = RobotHarness()
    if 'client' in names:
        given['client'] = client = harness.client(port)
        client.raw()
    test(**given)


@pytest.mark.slow
def test_every_statement_is_executed() -> None:
    """The tests of the servers and of main, run once more, leave no line of the program out."""
    with executed_lines() as lines:
        for module, port in PORTS.items():
            for name, test in vars(module).items():
                if name.startswith('test_'):
                    for given in _parameters(test):
                        _run(test, port, given)
    missing = {
        (file, number, FILES[file].split('\n')[number - 1].strip())
        for file, found in lines.items()
        for number, executed in found.items()
        if not executed and file != LINES_OF_BYTES
    }
    behind = {each for each in missing if each[2] == BEHIND_A_LOOP and each[0] in ENDLESS}
    assert sorted(missing - behind) == []
    assert {name for name in FILES if name.endswith('.prg')} == lines.keys()
    reported = {
        file: (len(found), sum(each[0] == file for each in behind))
        for file, found in lines.items()
    }
    page = re.findall(r'(?m)^\| `(\w+\.prg)` \| (\d+) \| (\d+) \|', PAGE.read_text('utf-8'))
    assert {file: (int(count), int(left)) for file, count, left in page} == reported


def test_no_name_is_a_word_of_spel() -> None:
    """RC+ refuses a variable that is named as a statement or function, some of which we lack."""
    words = {*COMMANDS, *NOT_SIMULATED, *STRUCTURE_WORDS, *TYPES, *FUNCTIONS}
    words |= {*OTHER_FUNCTIONS, *CONSTANTS}
    words |= {word.rstrip('$') for word in words}
    found = set()
    for file in build(FILES).files:
        for node in walk([*file.declarations, *file.functions]):
            if isinstance(node, Declaration):
                found |= {variable.name.lower() for variable in node.variables}
            elif isinstance(node, Function):
                found |= {node.name.lower(), *(each.name.lower() for each in node.parameters)}
            elif isinstance(node, Label):
                found.add(node.name.lower())
    assert found & words == {'main'} & words


@pytest.mark.parametrize('version', [6, 7, 8])
@pytest.mark.parametrize(
    'switches',
    one_in(
        4,
        [
            {},
            {'NO_BACKGROUND': '1'},
            {'START_MAIN': '1'},
            {
                'FULL_POWER': '',
                'AUTO_ONLY': '',
                'DOOR_ENDS_MOTION': '',
                'LOST_CLIENT_MOTORS_OFF': '',
                'IO_OFF_WHEN_LOST': '',
            },
        ],
    ),
    ids=str,
)
def test_the_linter_finds_nothing_with_any_switch(version: int, switches: dict[str, str]) -> None:
    assert [str(problem) for problem in check(changed(**switches), version)] == []
