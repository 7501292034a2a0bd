# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What make test, test-all and soak-tests choose, and how many examples they try."""

import os
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from hypothesis import settings
from support.examples import FULL, LEAST, PROFILES, examples, profile_for

ROOT = Path(__file__).resolve().parents[1]
MAKEFILE = (ROOT / 'Makefile').read_text(encoding='utf-8')
SETTINGS = tomllib.loads((ROOT / 'pyproject.toml').read_text(encoding='utf-8'))


def marks(text: str) -> str:
    """Return what a command chooses with -m."""
    return re.findall(r"-m '([^']+)'", text)[-1]


def goal(name: str) -> str:
    """Return what make does for a goal."""
    return re.findall(rf'(?m)^{name}:.*\n((?:\t.*\n)+)', MAKEFILE)[-1]


def test_each_goal_has_its_marks_and_its_examples() -> None:
    default = marks(SETTINGS['tool']['pytest']['ini_options']['addopts'])
    chosen = [default, marks(goal('test-all')), marks(goal('soak-tests'))]
    assert chosen == ['not slow and not soak', 'not soak', 'soak or hypothesis']
    assert marks(goal('test-rest')) == '(slow or hypothesis) and not soak'
    assert profile_for(marks(goal('test-rest'))) == profile_for(marks(goal('test-all')))
    assert [profile_for(each) for each in chosen] == list(PROFILES)
    assert '-m' not in goal('test').replace('-m pytest', '')


def test_ci_runs_what_a_newcomer_would() -> None:
    lines = (ROOT / '.ci' / 'run').read_text(encoding='utf-8').splitlines()
    made = [line for line in lines if line.startswith('make')]
    assert made == ['make browser', 'make test', 'make test-rest']


def test_no_profile_judges_by_time_and_only_soak_is_not_the_same_each_time() -> None:
    for name, profile in PROFILES.items():
        assert profile.deadline is None
        assert profile.derandomize == (name != 'soak')
    assert settings.default in PROFILES.values()


@pytest.mark.parametrize('count', [1, 5, 10, 30, 200])
def test_examples_are_a_share_of_what_a_test_names(count: int) -> None:
    share = settings.default.max_examples / FULL
    assert examples(count) == max(int(count * share), min(count, LEAST))


def test_no_process_compiles_its_modules_again() -> None:
    """Containers often forbid bytecode: then starting processes is half of what a run costs."""
    environment = os.environ | {'PYTHONDONTWRITEBYTECODE': '1'}
    code = f'include {ROOT / "Makefile"}\nshow-environment: ; @env\n'
    run = subprocess.run(
        ['make', '-f', '-', 'show-environment'],
        input=code, env=environment, cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert 'PYTHONDONTWRITEBYTECODE' not in run.stdout
