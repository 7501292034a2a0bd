# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What `make` installs, and what it says meanwhile: requirements/install.py."""

import importlib.util
import io
import json
import os
import platform
import pty
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
_spec = importlib.util.spec_from_file_location(
    'requirements_install', ROOT / 'requirements/install.py'
)
assert _spec is not None
assert _spec.loader is not None
install = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(install)

PIP_LINES = """\
Looking in indexes: https://pypi.org/simple, file:///opt/simple
WARNING: Location 'file:///opt/simple/numpy/' is ignored: it is neither a file nor a directory.
Collecting numpy (from -r requirements/runtime.txt (line 11))
  Downloading numpy-2.4.6-cp311-cp311-manylinux_2_28_x86_64.whl.metadata (6.6 kB)
Requirement already satisfied: PyYAML in ./.venv/lib/python3.11/site-packages (6.0.3)
  Using cached ros_fastrtps-2.14.5-cp311-cp311-manylinux_2_28_x86_64.whl (16.5 MB)
  Downloading numpy-2.4.6-cp311-cp311-manylinux_2_28_x86_64.whl (2.0 MB)
Progress 500000 of 2000000
"""


def stamps() -> dict[str, dict[str, float]]:
    """Return what the steps took in this environment, by name, where it was measured."""
    found = {}
    for name in install.STEPS:
        stamp = Path(sys.prefix, f'.{name}')
        text = stamp.read_text(encoding='utf-8').strip() if stamp.is_file() else ''
        if text and (took := json.loads(text)):
            found[name] = took
    return found


@pytest.mark.skipif(
    (sys.platform, platform.machine()) != ('linux', 'x86_64'),
    reason='the sizes that make names were measured on Linux, x86-64',
)
@pytest.mark.parametrize('name', ['runtime', 'interfaces', 'dev'])
def test_named_sizes_are_what_the_steps_took(name: str) -> None:
    took = stamps().get(name)
    if took is None:
        pytest.skip('this environment was not made in one go')
    step = install.STEPS[name]
    assert step.download == pytest.approx(took['download'], rel=0.15)
    assert step.disk == pytest.approx(took['disk'], rel=0.15, abs=10)


def test_every_requirement_has_one_version() -> None:
    name = re.compile(r'[A-Za-z0-9._-]+')
    lines = (ROOT / 'requirements/constraints.txt').read_text(encoding='utf-8').splitlines()[1:]
    assert all(re.fullmatch(r'[A-Za-z0-9._-]+==[\w.]+', line) for line in lines)
    pinned = {line.split('==')[0].lower().replace('_', '-') for line in lines}
    for file in (ROOT / 'requirements').glob('*.txt'):
        for line in file.read_text(encoding='utf-8').splitlines():
            if (match := name.match(line)) and match[0] != '-r':
                assert match[0].lower().replace('_', '-') in pinned, f'{file}: {line}'


def test_setup_py_and_the_requirement_files_name_the_same_packages() -> None:
    text = (ROOT / 'requirements/planning.txt').read_text(encoding='utf-8')
    names = re.findall(r'(?m)^[a-z][\w-]*', text)
    assert f"'planning': {names}" in (ROOT / 'setup.py').read_text(encoding='utf-8')


def test_progress_is_read_from_the_lines_of_pip() -> None:
    seen = install.Pip()
    kept = [line for line in PIP_LINES.splitlines() if seen.line(line)]
    assert kept == PIP_LINES.splitlines()[:-1]
    assert (seen.downloaded, seen.part) == (16.5, 0.5)
    assert seen.doing == 'numpy'
    assert seen.satisfied == {'pyyaml'}
    seen.line('Installing collected packages: ros-fastrtps, numpy')
    assert (seen.downloaded, seen.part, seen.unpacking) == (18.5, 0.0, 2)


@pytest.mark.parametrize(
    ('output', 'words'),
    [
        ('ERROR: [Errno 28] No space left on device', 'disk is full'),
        (
            'NewConnectionError: Failed to establish\n'
            'ERROR: No matching distribution found for ros-x',
            'network',
        ),
        (
            'ERROR: No matching distribution found for ros-rclpy==7.1.6',
            'install ROS 2 Jazzy itself',
        ),
        ('ERROR: No matching distribution found for ompl==2.0.1', 'Another Python may do'),
        ('To build ROS 2 interfaces this machine lacks:\n  * a C compiler', 'build-essential'),
        ('SSLCertVerificationError(1, ...)', 'PIP_CERT'),
        ('something else', 'make clean'),
    ],
)
def test_a_failure_says_what_to_do(output: str, words: str) -> None:
    assert words in install.hint(output)


def test_a_machine_that_lacks_something_is_told_before_the_download(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert list(install.missing(free=1000, needed=300)) == []
    monkeypatch.setenv('CXX', 'no-such-compiler -m64')
    lacking = list(install.missing(free=100, needed=300))
    assert [text.split(':')[0].split(' on ')[0] for text in lacking] == [
        'no no-such-compiler',
        '100 MB free',
    ]


@pytest.fixture
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that stands for .venv, whose Python is this one."""
    (tmp_path / 'bin').mkdir()
    (tmp_path / 'bin' / 'python').symlink_to(sys.executable)
    monkeypatch.setattr(install, 'VENV', tmp_path)
    monkeypatch.setattr(install, 'python', lambda: sys.executable)
    return tmp_path


def wheel(folder: Path) -> Path:
    """Write a wheel with one module."""
    path = folder / 'dummy_of_ours-1.0-py3-none-any.whl'
    info = 'dummy_of_ours-1.0.dist-info'
    with zipfile.ZipFile(path, 'w') as file:
        file.writestr('dummy_of_ours.py', '')
        file.writestr(
            f'{info}/METADATA', 'Metadata-Version: 2.1\nName: dummy_of_ours\nVersion: 1.0\n'
        )
        file.writestr(
            f'{info}/WHEEL', 'Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n'
        )
        file.writestr(f'{info}/RECORD', '')
    return path


def test_off_a_terminal_a_step_is_one_line_and_pips_words_are_in_the_log(
    environment: Path,
) -> None:
    stream = io.StringIO()
    bar = install.Bar('tools', ' (1 MB)', stream)
    seen = install.Pip()
    file = wheel(environment)
    command = install.pip(
        'install', '--no-index', '--no-deps', '--target', str(environment / 't'), str(file)
    )
    install.run([command], bar, seen)
    bar.end(well=True)
    assert (environment / 't' / 'dummy_of_ours.py').is_file()
    assert stream.getvalue() == 'tools (1 MB)\n'
    assert seen.downloaded == pytest.approx(file.stat().st_size / 1e6)
    assert 'Successfully installed dummy' in (environment / 'install.log').read_text()


def test_a_step_that_fails_shows_what_pip_said_and_what_to_do(
    environment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No index answers on this port: a real run of pip without a network."""
    monkeypatch.setenv('PIP_INDEX_URL', 'http://127.0.0.1:9/simple')
    monkeypatch.setenv('PIP_RETRIES', '1')
    monkeypatch.setenv('PIP_CONFIG_FILE', os.devnull)
    monkeypatch.setenv('PIP_QUIET', '3')  # a user's own setting must not hide the reason
    bar = install.Bar('tools', '', io.StringIO())
    command = install.pip('download', '-d', str(environment), 'dummy-of-ours')
    with pytest.raises(install.CannotInstallError) as failed:
        install.run([command], bar)
    said = str(failed.value)
    assert 'No matching distribution found for dummy-of-ours' in said
    assert said.endswith('Then run make again.')
    assert 'could not be reached' in said


def test_a_terminal_gets_a_bar_and_one_line_in_the_end() -> None:
    master, slave = pty.openpty()
    with os.fdopen(slave, 'w') as terminal:
        bar = install.Bar('tools', ' (1 MB)', terminal)
        bar.draw(0.5, 'numpy')
        bar.end(well=True)
        written = ''
        while '\n' not in written:
            written += os.read(master, 65536).decode()
    os.close(master)
    assert f'[{"#" * 12}{"." * 12}] 0:00 numpy' in written
    last = written.rstrip('\r\n').rpartition('\r\x1b[K')[2]
    assert last == 'tools (1 MB): 0 s'
    assert written.count('\n') == 1


def test_alike_libraries_share_their_bytes_and_headers_go(
    environment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = environment / 'lib' / 'python3.11' / 'site-packages'
    kept = {
        site / 'a.libs' / 'libfoo-1.so': b'foo' * 5000,
        site / 'b.libs' / 'libfoo-1.so': b'foo' * 5000,
        site / 'b.libs' / 'libbar-1.so': b'bar' * 5000,
        site / 'numpy' / 'core.py': b'',
    }
    gone = [
        site / 'cmeel.prefix' / 'include' / 'boost' / 'any.hpp',
        site / 'cmeel.prefix' / 'lib' / 'libqhull.a',
        site / 'numpy' / 'fft' / 'tests' / 'test_fft.py',
    ]
    for path, content in (kept | dict.fromkeys(gone, b'x')).items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    before = install.disk_use(environment)
    install.slim()
    assert {path: path.read_bytes() for path in kept} == kept
    assert not any(path.exists() for path in gone)
    assert (site / 'a.libs' / 'libfoo-1.so').samefile(site / 'b.libs' / 'libfoo-1.so')
    assert install.disk_use(environment) < before - 0.015


@pytest.mark.parametrize(
    ('goal', 'steps'), [('demo', ()), ('test', ('dev',)), ('demo ARGS=--plan', ('planning',))]
)
def test_make_names_all_sizes_before_the_first_download(goal: str, steps: tuple[str, ...]) -> None:
    command = ['make', '--dry-run', *goal.split(), 'VENV=no-such-folder']
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    first, *rest = re.findall(r'install\.py (.*)', run.stdout)
    assert first.split() == ['runtime', '--all', 'runtime', 'interfaces', *steps]
    assert [line.split()[0] for line in rest] == ['interfaces', 'driver', *steps]


def test_make_says_that_python_is_too_old(tmp_path: Path) -> None:
    old = tmp_path / 'old-python'
    old.write_text('#!/bin/sh\nexit 1\n', encoding='utf-8')
    old.chmod(0o755)
    for python, words in ((old, 'too old'), (tmp_path / 'none', 'no ')):
        command = ['make', 'demo', f'PYTHON={python}', f'VENV={tmp_path / "venv"}']
        run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert run.returncode != 0
        assert words in run.stderr
        assert 'Python 3.11 or newer is needed' in run.stderr


def test_make_does_not_use_an_environment_of_another_python(tmp_path: Path) -> None:
    (tmp_path / 'pyvenv.cfg').touch()
    (tmp_path / 'lib' / 'python3.9').mkdir(parents=True)
    command = ['make', '--dry-run', 'demo', f'PYTHON={sys.executable}', f'VENV={tmp_path}']
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode != 0
    assert 'make clean' in run.stderr
    command[2] = 'clean'
    subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
