# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What `make` installs, and what it says when it cannot."""

import platform
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
REQUIREMENTS = ROOT / 'requirements'
BUILD = ROOT / 'interfaces' / 'requirements-build.txt'


def make(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run make in the checkout."""
    words = [f'{name}={value}' for name, value in environment.items()]
    command = ['env', *words, 'make', *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def canonical(name: str) -> str:
    """Return the name by which a package is the same in every spelling."""
    return re.sub(r'[-_.]+', '-', name).lower()


def pinned() -> dict[str, str]:
    """Return the version of each package in the constraints that has a hash."""
    text = (REQUIREMENTS / 'constraints.txt').read_text(encoding='utf-8')
    found = re.findall(r'(?m)^([\w.-]+)==(\S+).* \\\n    --hash=sha256:[0-9a-f]{64}', text)
    assert len(found) == len(re.findall(r'(?m)^[\w.-]+==', text))
    return {canonical(name): version for name, version in found}


def required() -> Iterator[tuple[str, str]]:
    """Yield the packages that the requirement files name, and the version if they do."""
    for path in {*REQUIREMENTS.glob('*.txt'), BUILD} - {REQUIREMENTS / 'constraints.txt'}:
        text = path.read_text(encoding='utf-8')
        for name, version in re.findall(r'(?m)^([A-Za-z][\w.-]*)(?:\[\w+\])?(?:==(\S+))?', text):
            yield canonical(name), version


def test_every_requirement_has_one_version_and_hashes() -> None:
    versions = pinned()
    assert {name: version for name, version in required() if name not in versions} == {}
    other = {name: v for name, v in required() if v and v != versions[name]}
    assert other == {}


def test_no_file_of_requirements_names_an_index() -> None:
    for path in {*REQUIREMENTS.glob('*.txt'), BUILD}:
        text = path.read_text(encoding='utf-8')
        assert not re.search(r'https?://|--(extra-)?index-url|--find-links', text), path


@pytest.mark.parametrize(
    ('goal', 'last'),
    [('demo', 'driver'), ('test', 'dev'), ('docs', 'docs'), ('demo ARGS=--panel', 'panel')],
)
def test_what_comes_from_an_index_is_checked_by_its_hash(goal: str, last: str) -> None:
    run = make('--dry-run', *goal.split(), 'VENV=no-such-folder')
    installs = [line for line in run.stdout.splitlines() if 'pip' in line and ' install ' in line]
    assert len(installs) >= 5
    for line in installs:
        local = '--no-deps' in line and '--no-build-isolation' in line
        assert local or '--require-hashes' in line, line
    assert f'no-such-folder/.{last}' in run.stdout


@pytest.mark.skipif(
    (sys.platform, platform.machine()) != ('linux', 'x86_64'),
    reason='the sizes that make names were measured on Linux, x86-64',
)
def test_the_sizes_that_make_names_are_about_those_of_this_environment() -> None:
    text = (ROOT / 'Makefile').read_text(encoding='utf-8')
    sizes = dict(re.findall(r'(?m)^SIZE_(\w+) := \d+ MB to download, (\d+) MB on disk$', text))
    environment = Path(sys.prefix)
    steps = ('runtime', 'interfaces', 'dev', 'browser', 'docs')  # panel is in dev
    there = [int(sizes[step]) for step in steps if (environment / f'.{step}').is_file()]
    if not there:
        pytest.skip('this environment was not made by make')
    run = subprocess.run(['du', '-sm', environment], capture_output=True, text=True, check=True)
    assert sum(there) == pytest.approx(int(run.stdout.split()[0]), rel=0.3)


def test_make_says_that_python_is_too_old(tmp_path: Path) -> None:
    old = tmp_path / 'old-python'
    old.write_text('#!/bin/sh\nexit 1\n', encoding='utf-8')
    old.chmod(0o755)
    for python, words in ((old, 'too old'), (tmp_path / 'none', 'no ')):
        run = make('demo', f'PYTHON={python}', f'VENV={tmp_path / "venv"}')
        assert run.returncode != 0
        assert words in run.stderr
        assert 'Python 3.11 or newer is needed' in run.stderr


def test_make_says_that_there_is_no_compiler(tmp_path: Path) -> None:
    run = make('demo', f'VENV={tmp_path / "venv"}', CXX='no-such-compiler -m64')
    assert run.returncode != 0
    assert run.stderr.startswith('no no-such-compiler: a C and a C++ compiler are needed')
    assert not (tmp_path / 'venv').exists()


@pytest.mark.slow
def test_make_says_that_the_index_could_not_be_reached_and_goes_on_later(tmp_path: Path) -> None:
    nobody = {'PIP_INDEX_URL': 'http://127.0.0.1:9/simple', 'PIP_CONFIG_FILE': '/dev/null'}
    run = make('demo', f'VENV={tmp_path}', PIP_FIND_LINKS='', PIP_RETRIES='0', **nobody)
    assert run.returncode != 0
    assert 'No matching distribution found for pip==' in run.stderr
    assert 'No connection: check the network' in run.stderr
    assert not (tmp_path / 'pip.txt').exists()


def test_make_does_not_use_an_environment_of_another_python(tmp_path: Path) -> None:
    (tmp_path / 'pyvenv.cfg').touch()
    (tmp_path / 'lib' / 'python3.9').mkdir(parents=True)
    arguments = ['--dry-run', 'demo', f'PYTHON={sys.executable}', f'VENV={tmp_path}']
    run = make(*arguments)
    assert run.returncode != 0
    assert 'make clean' in run.stderr
    arguments[1] = 'clean'
    assert make(*arguments).returncode == 0
