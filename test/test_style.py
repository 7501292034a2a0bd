# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The style of our own files, and what each tier of tests holds."""

import ast
import os
import re
import runpy
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings
from support.examples import FULL, LEAST, PROFILES, examples, profile_for

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


@pytest.mark.parametrize(
    'command',
    [
        'ruff check .',
        'ruff format --check .',
        pytest.param('mypy', marks=pytest.mark.slow),
        pytest.param('mypy --config-file test/mypy.ini test', marks=pytest.mark.slow),
    ],
)
def test_the_linters_find_nothing(command: str) -> None:
    run = subprocess.run(
        [sys.executable, '-m', *command.split()],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr


def test_the_first_line_of_a_docstring_is_one_clause() -> None:
    found = [
        f'{path.relative_to(ROOT)}: {first}'
        for path in sorted((ROOT / 'epson_driver').rglob('*.py'))
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        if isinstance(node, DOCUMENTED)
        if ';' in (first := (ast.get_docstring(node) or '').partition('\n')[0])
    ]
    assert not found, '\n'.join(found)


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


def test_every_test_file_has_a_name_of_its_own() -> None:
    """One process that runs two files of one name collects the second one as the first."""
    names = Counter(path.name for path in (ROOT / 'test').rglob('test_*.py'))
    assert [name for name, count in names.items() if count > 1] == []


def test_no_process_compiles_its_modules_again() -> None:
    """Containers often forbid bytecode: then starting processes is half of what a run costs."""
    environment = os.environ | {'PYTHONDONTWRITEBYTECODE': '1'}
    code = f'include {ROOT / "Makefile"}\nshow-environment: ; @env\n'
    run = subprocess.run(
        ['make', '-f', '-', 'show-environment'],
        input=code, env=environment, cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert 'PYTHONDONTWRITEBYTECODE' not in run.stdout


DOCS = Path(__file__).resolve().parents[1] / 'docs'


def test_every_invariant_of_the_page_has_tests() -> None:
    page = (DOCS / 'invariants.md').read_text(encoding='utf-8')
    described = re.findall(r'(?m)^(\d+)\. [A-Z]', page)
    lines = ''.join(runpy.run_path(str(DOCS / 'make_tables.py'))['invariants']())
    assert re.findall(r'\* \*\*(\d+)\*\*\n  \* `test/', lines) == described
