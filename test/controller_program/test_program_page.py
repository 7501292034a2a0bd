# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/controller_program.md: its programs are SPEL+, and it has every name of config.inc."""

import re
import textwrap
from pathlib import Path

import pytest
from support.robot_program import FILES

from epson_driver.spel.lint import check

PAGE = (Path(__file__).parents[2] / 'docs' / 'controller_program.md').read_text(encoding='utf-8')
PROGRAMS = [textwrap.dedent(each) for each in re.findall(r'(?s)```spel\n(.*?)```', PAGE)]
ONE_LINE_OF_LOOP = 'endless-loop'
"""What question 9 asks for."""


@pytest.mark.parametrize('program', PROGRAMS, ids=range(1, len(PROGRAMS) + 1))
def test_the_programs_of_the_questions_can_be_built(program: str) -> None:
    found = {problem.rule for problem in check({'main.prg': program}, 6)}
    assert found <= {ONE_LINE_OF_LOOP}


def test_the_page_has_every_name_of_config() -> None:
    names = re.findall(r"(?m)^'?#define (\w+)", FILES['config.inc'])
    written = set(re.findall(r'`([A-Z]\w*|…_\w+|\w+_…)`', PAGE))
    patterns = [each.replace('…', '') for each in written if '…' in each]
    for name in names:
        covered = any(name.startswith(p) or name.endswith(p) for p in patterns)
        assert name in written or covered or re.fullmatch(r'J\d_SPEED', name), name


def test_the_page_has_every_error_number_of_the_program() -> None:
    numbers = re.findall(r'nError\d=(\d+)', FILES['UserErrors.dat'])
    numbers += re.findall(
        r'(?m)^#define \w+ (\d{4})$', FILES['messages.inc'].split('STATUS besides')[1]
    )
    for number in numbers:
        assert f'| {number} |' in PAGE, number
