# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/controller_program.md: its programs are SPEL+, and it has every name of config.inc."""

import logging
import re
import textwrap
from pathlib import Path

import pytest
from support.controller_harness import MODEL
from support.robot_program import FILES
from support.spel_program_harness import SPEL_PROFILE, SpelProgramHarness

from epson_driver.sim_controller.spel_host.profile_project import profile_project
from epson_driver.spel.lint import check

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / 'docs' / 'controller_program.md').read_text(encoding='utf-8')
PROGRAMS = [textwrap.dedent(each) for each in re.findall(r'(?s)```spel\n(.*?)```', PAGE)]
ONE_LINE_OF_LOOP = 'endless-loop'
"""What question 9 asks for."""


@pytest.mark.parametrize('program', PROGRAMS, ids=range(1, len(PROGRAMS) + 1))
def test_the_programs_of_the_questions_can_be_built(program: str) -> None:
    files = {'main.prg': program, 'UserErrors.dat': FILES['UserErrors.dat']}
    found = {problem.rule for problem in check(files, 6)}
    assert found <= {ONE_LINE_OF_LOOP}


def test_the_page_has_every_name_of_config() -> None:
    names = re.findall(r"(?m)^'?#define (\w+)", FILES['config.inc'])
    written = set(re.findall(r'`([A-Z]\w*|…_\w+|\w+_…)`', PAGE))
    patterns = [each.replace('…', '') for each in written if '…' in each]
    for name in names:
        covered = any(name.startswith(p) or name.endswith(p) for p in patterns)
        assert name in written or covered or re.fullmatch(r'J\d_SPEED', name), name


def test_the_page_names_every_system_test_that_is_not_run_with_the_program() -> None:
    for path in sorted((ROOT / 'test' / 'system').glob('test_*.py')):
        run_with_it = re.search(r'\bPROGRAMS\b|\bspel\b', path.read_text(encoding='utf-8'))
        assert bool(run_with_it) != (f'`{path.name}`' in PAGE), path.name


def test_the_page_has_every_error_number_of_the_program() -> None:
    numbers = re.findall(r'nError\d=(\d+)', FILES['UserErrors.dat'])
    numbers += re.findall(
        r'(?m)^#define \w+ (\d{4})$', FILES['messages.inc'].split('STATUS besides')[1]
    )
    for number in numbers:
        assert f'| {number} |' in PAGE, number


def test_the_page_s_measurement_finds_how_long_accelerations_take(caplog) -> None:
    """What a person is told to measure is what the simulated arm has, and the profile puts in."""
    caplog.set_level(logging.INFO)
    (program,) = [each for each in PROGRAMS if 'RAMP_MS' in each]
    harness = SpelProgramHarness(program, caplog)
    harness.until(lambda: harness.printed)
    _, quick, _, ramp = harness.printed[0].split()
    config = profile_project(SPEL_PROFILE.spel, MODEL)['config.inc']
    wanted = dict(re.findall(r'(?m)^#define (T100_MS|RAMP_MS) (\d+)', config))
    assert float(quick) == pytest.approx(float(wanted['T100_MS']), abs=2.0)
    assert float(ramp) == pytest.approx(float(wanted['RAMP_MS']), abs=2.0)
