# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The `epson_driver` command itself."""

import subprocess
import sys

import pytest

from epson_driver.cli.__main__ import EXECUTABLES


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


@pytest.mark.parametrize('name', ['client', 'demo'])
def test_without_ros_it_says_what_is_missing(name: str) -> None:
    run = command(name, before='sys.modules["rclpy"] = None')
    assert run.returncode == 1
    assert 'the Python module rclpy is missing' in run.stderr
    assert 'Traceback' not in run.stderr


def test_the_simulated_controller_needs_no_ros() -> None:
    run = command('sim_controller', '--help', before='sys.modules["rclpy"] = None')
    assert run.returncode == 0
    assert '--start' in run.stdout
