# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""requirements/hashes.txt: pip installs nothing that it does not list."""

import importlib.util
import re
import subprocess
import sys
import zipfile
from hashlib import sha256
from pathlib import Path
from types import ModuleType

import pytest
import setuptools  # noqa: F401 - before pip, whose import takes its distutils away

ROOT = Path(__file__).parents[2]
HASHES = ROOT / 'requirements' / 'hashes.txt'
BLOCK = re.compile(r'([\w.-]+)==(\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)\n')


def loaded(name: str) -> ModuleType:
    """Return one of the programs beside the requirement files."""
    spec = importlib.util.spec_from_file_location(name, ROOT / 'requirements' / f'{name}.py')
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


pip = pytest.importorskip('pip', reason='this environment has no pip')
make_hashes = loaded('make_hashes')
install = loaded('install')


def test_every_pinned_package_has_hashes_and_nothing_else_has() -> None:
    head, text = re.split(r'(?m)^(?=[^#])', HASHES.read_text(encoding='utf-8'), maxsplit=1)
    assert all(line.startswith('#') for line in head.splitlines())
    assert BLOCK.sub('', text) == ''
    assert [match.groups()[:2] for match in BLOCK.finditer(text)] == list(make_hashes.pinned())


def test_what_the_messages_are_built_with_is_pinned_alike() -> None:
    text = (ROOT / 'interfaces' / 'requirements-build.txt').read_text(encoding='utf-8')
    wanted = re.findall(r'(?m)^([\w.-]+)(?:\[\w+\])?==(\S+)', text)
    assert len(wanted) > 20
    pinned = {(name.replace('_', '-'), version) for name, version in make_hashes.pinned()}
    assert set(wanted) <= pinned


def test_no_file_of_requirements_names_an_index() -> None:
    for path in (ROOT / 'requirements').glob('*.txt'):
        text = path.read_text(encoding='utf-8')
        assert not re.search(r'https?://|--(extra-)?index-url|--find-links', text), path


@pytest.mark.parametrize(
    ('filename', 'is_wanted'),
    [
        ('a-1.0-py3-none-any.whl', True),
        ('a-1.0-py2.py3-none-any.whl', True),
        ('a-1.0-cp311-cp311-manylinux_2_28_x86_64.whl', True),
        ('a-1.0-cp314-cp314-manylinux_2_28_aarch64.whl', True),
        ('a-1.0-cp39-abi3-manylinux2014_x86_64.manylinux_2_17_x86_64.whl', True),
        ('a-1.0-py3-none-macosx_11_0_arm64.whl', True),
        ('a-1.0-cp312-cp312-macosx_10_13_universal2.whl', True),
        ('a-1.0.tar.gz', True),
        ('a-1.1.tar.gz', False),
        ('a-1.1-py3-none-any.whl', False),
        ('a-1.0-cp310-cp310-manylinux_2_28_x86_64.whl', False),
        ('a-1.0-cp313-cp313t-manylinux_2_28_x86_64.whl', False),
        ('a-1.0-cp315-cp315-manylinux_2_28_x86_64.whl', False),
        ('a-1.0-cp311-cp311-musllinux_1_2_x86_64.whl', False),
        ('a-1.0-cp311-cp311-win_amd64.whl', False),
        ('a-1.0-pp311-pypy311_pp73-manylinux_2_28_x86_64.whl', False),
        ('a-1.0.exe', False),
    ],
)
def test_files_for_supported_pythons_and_systems_are_listed(
    filename: str, is_wanted: bool
) -> None:
    assert make_hashes.wanted(filename, '1.0') == is_wanted


def wheel(folder: Path, content: str) -> Path:
    """Write a wheel with one module."""
    info = 'a_of_ours-1.0.dist-info'
    path = folder / 'a_of_ours-1.0-py3-none-any.whl'
    with zipfile.ZipFile(path, 'w') as file:
        file.writestr('a_of_ours.py', content)
        file.writestr(f'{info}/METADATA', 'Metadata-Version: 2.1\nName: a-of-ours\nVersion: 1.0\n')
        file.writestr(
            f'{info}/WHEEL', 'Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n'
        )
        file.writestr(f'{info}/RECORD', '')
    return path


@pytest.mark.slow
@pytest.mark.skipif(
    int(pip.__version__.split('.')[0]) < 26, reason='older pips know no hashes in constraints'
)
def test_another_file_of_the_same_name_is_not_installed(tmp_path: Path) -> None:
    """As `make` calls pip: requirements without versions, two files of constraints."""
    listed = sha256(wheel(tmp_path, 'x = 1').read_bytes()).hexdigest()
    (tmp_path / 'constraints.txt').write_text('a-of-ours==1.0\n', encoding='utf-8')
    block = make_hashes.block('a-of-ours', '1.0', [listed])
    (tmp_path / 'hashes.txt').write_text(f'{block}\n', encoding='utf-8')
    (tmp_path / 'runtime.txt').write_text('a-of-ours\n', encoding='utf-8')
    words = ['install', '--no-index', '--find-links', '.', '--target', 'there', '--upgrade']
    files = ['-c', 'constraints.txt', '-c', 'hashes.txt', '-r', 'runtime.txt']

    def run() -> subprocess.CompletedProcess[str]:
        command = [sys.executable, '-m', 'pip', '--isolated', *words, *files]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)

    first = run()
    assert first.returncode == 0, first.stderr
    wheel(tmp_path, 'x = 2')
    second = run()
    assert second.returncode == 1
    assert 'DO NOT MATCH THE HASHES' in second.stderr
    assert 'do not install it' in install.hint(second.stderr)
    (tmp_path / 'hashes.txt').write_text(f'{block}\n'.replace('a-of', 'b-of'), encoding='utf-8')
    third = run()
    assert third.returncode == 1
    assert 'make hashes' in install.hint(third.stderr)
