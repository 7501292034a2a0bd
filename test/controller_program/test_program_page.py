# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The page about the controller program, and the syntax of the program."""

import logging
import re
from pathlib import Path

import pytest
from support.controller_harness import MODEL
from support.examples import one_in
from support.spel_program_harness import OUR_FILES, SPEL_PROFILE, SpelProgramHarness

from epson_driver.sim_controller.assembly import profile_project
from epson_driver.spel import build, with_defines
from epson_driver.spel.lint import check
from epson_driver.spel.syntax import Assign, Binary, Declaration, OnErr, walk

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / 'docs' / 'controller_program.md').read_text(encoding='utf-8')
PROGRAMS = sorted((ROOT / 'docs' / 'examples' / 'spel').glob('*.prg'))
LOOP_WITHOUT_WAIT = 'endless-loop'
"""The subject of one of the questions."""


@pytest.mark.parametrize('program', PROGRAMS, ids=lambda each: each.stem)
def test_programs_of_the_questions_can_be_built(program: Path) -> None:
    assert f'(examples/spel/{program.name})' in PAGE
    files = {
        'main.prg': program.read_text(encoding='utf-8'),
        'UserErrors.dat': OUR_FILES['UserErrors.dat'],
    }
    result = {problem.rule for problem in check(files, 6)}
    assert result <= {LOOP_WITHOUT_WAIT}


def test_page_has_every_name_of_config() -> None:
    names = re.findall(r"(?m)^'?#define (\w+)", OUR_FILES['config.inc'])
    written = set(re.findall(r'`([A-Z]\w*|…_\w+|\w+_…)`', PAGE))
    patterns = [item.replace('…', '') for item in written if '…' in item]
    for name in names:
        covered = any(name.startswith(p) or name.endswith(p) for p in patterns)
        assert name in written or covered or re.fullmatch(r'J\d_SPEED', name), name


def test_page_has_every_error_number_of_the_program() -> None:
    numbers = re.findall(r'nError=(\d+)', OUR_FILES['UserErrors.dat'])
    numbers += re.findall(
        r'(?m)^#define \w+ (\d{4})$', OUR_FILES['messages.inc'].split('numbers in STATUS')[1]
    )
    for number in numbers:
        assert f'| {number} |' in PAGE, number


def test_measurement_of_the_page_returns_the_acceleration_times(caplog) -> None:
    """The measured times are those of the simulated arm and of the profile."""
    caplog.set_level(logging.INFO)
    (program,) = [item for item in PROGRAMS if item.stem == 'measure_accelerations']
    harness = SpelProgramHarness(program.read_text(encoding='utf-8'), caplog)
    harness.until(lambda: harness.printed)
    _, quick, _, ramp = harness.printed[0].split()
    config = profile_project(SPEL_PROFILE, MODEL)['config.inc']
    wanted = dict(re.findall(r'(?m)^#define (T100_MS|RAMP_MS) (\d+)', config))
    assert float(quick) == pytest.approx(float(wanted['T100_MS']), abs=2.0)
    assert float(ramp) == pytest.approx(float(wanted['RAMP_MS']), abs=2.0)


FUNCTIONS = {each.name: each for file in build(OUR_FILES).files for each in file.functions}
ARITHMETIC = ('+', '-', '*', '/', 'mod', 'and')


@pytest.mark.parametrize('name', ['BgMain', 'MotionServer', 'StateServer', 'IoServer'])
def test_no_background_task_has_a_statement_outside_an_error_handler(name: str) -> None:
    first = next(item for item in FUNCTIONS[name].body if not isinstance(item, Declaration))
    assert isinstance(first, OnErr)


def test_program_uses_only_old_syntax() -> None:
    """Assigned comparisons have brackets, and SetNet names its protocol."""
    for node in walk([function.body for function in FUNCTIONS.values()]):
        if isinstance(node, Assign) and isinstance(node.value, Binary):
            line = OUR_FILES[node.at.file].split('\n')[node.at.line - 1]
            value = line[node.target.at.column - 1 :].partition(' = ')[2]
            assert node.value.operator in ARITHMETIC or value.startswith('('), line
    for arguments in re.findall(r'(?m)^ *SetNet (.*)$', ''.join(OUR_FILES.values())):
        assert arguments.endswith('CRLF, NONE, 2')


@pytest.mark.parametrize('version', one_in(3, [7, 6, 8]))
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
def test_linter_finds_nothing_with_any_switch(version: int, switches: dict[str, str]) -> None:
    assert [str(problem) for problem in check(with_defines(OUR_FILES, switches), version)] == []
