# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The `epson_driver` command itself."""

import errno
import subprocess
import sys
from pathlib import Path

import pytest
from support.examples import one_in

from epson_driver.cli import __main__ as main
from epson_driver.cli.arguments import if_in_use
from epson_driver.cli.executables import EXECUTABLES


def command(*arguments: str, before: str = '') -> subprocess.CompletedProcess[str]:
    code = f'import sys; {before}\nfrom epson_driver.cli.__main__ import main; sys.exit(main())'
    return subprocess.run(
        [sys.executable, '-c', code, *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_help_lists_every_executable() -> None:
    run = command('--help')
    assert run.returncode == 0
    for name, text in EXECUTABLES.items():
        assert f'  {name:15} {text}' in run.stdout


@pytest.mark.parametrize('arguments', [(), ('robot',)])
def test_unknown_executable_is_answered_with_the_list(arguments: tuple[str, ...]) -> None:
    run = command(*arguments)
    assert run.returncode == 2
    assert 'sim_controller' in run.stderr


def test_an_unknown_executable_is_named_with_the_nearest_one() -> None:
    run = command('robot')
    assert run.stderr.startswith("epson_driver: no executable 'robot'; did you mean robots?\n")
    assert command('xyz').stderr.startswith("epson_driver: no executable 'xyz'\n")


def test_the_version_is_that_of_the_package() -> None:
    root = Path(__file__).parents[2]
    run = command('--version')
    assert run.returncode == 0
    assert f"version='{run.stdout.split()[1]}'," in (root / 'setup.py').read_text('utf-8')
    assert run.stdout == f'epson_driver {run.stdout.split()[1]}\n'


def test_every_executable_is_installed_for_ros2_run() -> None:
    scripts = {path.name for path in (Path(__file__).parents[2] / 'scripts').iterdir()}
    assert scripts == {'executable', *EXECUTABLES}


@pytest.mark.parametrize('name', one_in(4, EXECUTABLES))
def test_every_usage_begins_alike(name: str) -> None:
    run = command(name, '--help')
    assert run.returncode == 0
    assert run.stdout.startswith(f'usage: epson_driver {name} ')


@pytest.mark.parametrize(
    'words',
    [['--seed=3'], pytest.param(['--seeds=2'], marks=pytest.mark.slow), ['--compare', '--seed=1']],
)
def test_seeds_without_plan_are_refused(words: list[str]) -> None:
    run = command('demo', *words)
    assert run.returncode == 2
    assert 'error: --seed and --seeds say what --plan plans' in run.stderr


@pytest.mark.parametrize('package', ['epson_msgs', 'industrial_msgs'])
def test_without_the_messages_it_says_how_they_are_built(package: str) -> None:
    run = command('client', before=f'sys.modules["{package}"] = None')
    assert run.returncode == 1
    assert f'the Python module {package} is missing' in run.stderr
    assert 'colcon build --base-paths src/epson_driver src/epson_driver/interfaces' in run.stderr
    assert f'pip install ./interfaces/{package}' in run.stderr


@pytest.mark.parametrize('name', ['client', 'demo'])
def test_without_ros_it_says_what_is_missing(name: str) -> None:
    run = command(name, before='sys.modules["rclpy"] = None')
    assert run.returncode == 1
    (line,) = run.stderr.splitlines()
    assert 'the Python module rclpy is missing' in line
    assert "pip install 'epson_driver[ros]'" in line
    assert 'Traceback' not in run.stderr


def test_the_simulated_controller_needs_no_ros() -> None:
    run = command('sim_controller', '--help', before='sys.modules["rclpy"] = None')
    assert run.returncode == 0
    assert '--start' in run.stdout


def test_what_comes_with_an_extra_is_named_with_it() -> None:
    assert main._missing('matplotlib') == (
        "the Python module matplotlib is missing: pip install 'epson_driver[report]'"
    )


@pytest.mark.parametrize('name', ['epson_driver.cli.robot', 'epson_driver', None])
def test_a_module_of_our_own_that_is_missing_is_a_fault_and_no_advice(
    monkeypatch: pytest.MonkeyPatch, name: str | None
) -> None:
    def missing(_name: str) -> None:
        raise ModuleNotFoundError(f'No module named {name!r}', name=name)

    monkeypatch.setattr(main, 'import_module', missing)
    monkeypatch.setattr(sys, 'argv', ['epson_driver', 'robots'])
    with pytest.raises(ModuleNotFoundError):
        main._run()


def test_only_a_port_that_is_taken_has_the_advice_for_it() -> None:
    assert if_in_use(None) == if_in_use(OSError(errno.EACCES, 'x')) == ''
    assert '--motion-port' in if_in_use(OSError(errno.EADDRINUSE, 'x'))
