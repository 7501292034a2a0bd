# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Shells in which ROS cannot start: a sentence and exit code 1 from every executable."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest

from epson_driver.cli.__main__ import NEED_ROS
from epson_driver.processes import processes
from epson_driver.processes.command import EXECUTABLES
from epson_driver.processes.ros_shell import shell_problems

ENFORCED = {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce'}

SHELLS = {
    'no HOME': ({'HOME': ''}, 'log: HOME is not set: set ROS_LOG_DIR'),
    'read-only log': ({'ROS_LOG_DIR': '/dev/null/log'}, 'log: /dev/null/log cannot be written'),
    'read-only home': ({'HOME': '/dev/null'}, 'log: /dev/null/.ros/log cannot be written'),
    'ROS_HOME': ({'ROS_HOME': '/dev/null'}, 'log: /dev/null/log cannot be written'),
    'another middleware': (
        {'RMW_IMPLEMENTATION': 'rmw_of_another_maker'},
        'RMW_IMPLEMENTATION: rmw_of_another_maker is not installed: install or unset it',
    ),
    'no keys': (ENFORCED, 'security: security is enforced, but ROS_SECURITY_KEYSTORE'),
    'folder of keys missing': (
        ENFORCED | {'ROS_SECURITY_KEYSTORE': '/dev/null/keys'},
        'security: security is enforced, but ROS_SECURITY_KEYSTORE',
    ),
}

FINE = {
    'log folder without HOME': {'HOME': '', 'ROS_LOG_DIR': 'logs/of/today'},
    'installed middleware': {'RMW_IMPLEMENTATION': 'rmw_fastrtps_cpp'},
    'another prefix': {'AMENT_PREFIX_PATH': '/opt/ros/other'},
    'permissive security': {'ROS_SECURITY_ENABLE': 'true'},
    'keys': ENFORCED | {'ROS_SECURITY_KEYSTORE': '/'},
}


def text_of(changes: dict[str, str]) -> str:
    environment = {'HOME': str(Path.cwd())} | changes
    return '\n'.join(': '.join(problem) for problem in shell_problems(environment))


@pytest.mark.parametrize(('changes', 'text'), SHELLS.values(), ids=SHELLS)
def test_shell_without_ros_is_found(changes: dict[str, str], text: str) -> None:
    assert text_of(changes).startswith(text)


@pytest.mark.parametrize('changes', FINE.values(), ids=FINE)
def test_shell_in_which_ros_starts_has_no_problem(
    changes: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert text_of(changes) == ''


@pytest.mark.parametrize(
    ('files', 'text'),
    [
        (20, 'open files: the limit is 20: ulimit -n 1024'),
        (64, ''),
        (resource.RLIM_INFINITY, ''),
    ],
)
def test_too_few_open_files_are_found(
    files: int, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resource, 'getrlimit', lambda _: (files, files))
    assert text_of({'ROS_LOG_DIR': str(tmp_path)}) == text


def test_middleware_of_another_prefix_is_found(tmp_path: Path) -> None:
    index = tmp_path / 'share/ament_index/resource_index/packages'
    index.mkdir(parents=True)
    (index / 'rmw_mine').touch()
    changes = {'RMW_IMPLEMENTATION': 'rmw_mine', 'AMENT_PREFIX_PATH': f'/opt/ros:{tmp_path}'}
    assert text_of(changes) == ''


def started(name: str, changes: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-m', 'epson_driver.cli', *name.split()],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env=processes.ros_environment(processes.free_ros_domain()) | changes,
    )


@pytest.mark.slow
@pytest.mark.parametrize('name', NEED_ROS)
@pytest.mark.parametrize(('changes', 'text'), SHELLS.values(), ids=SHELLS)
def test_executable_reports_the_shell_in_one_sentence(
    name: str, changes: dict[str, str], text: str
) -> None:
    if 'HOME' in changes:
        changes = changes | {'ROS_LOG_DIR': ''}
    run = started(name, changes)
    assert (run.returncode, run.stdout) == (1, '')
    assert run.stderr.startswith(f'epson_driver {name}: {text}')
    assert run.stderr.count('\n') == 1


@pytest.mark.parametrize('name', [*NEED_ROS, 'panel'])
def test_another_ros_is_reported_in_one_sentence(name: str, tmp_path: Path) -> None:
    (tmp_path / 'rclpy').mkdir()
    (tmp_path / 'rclpy/__init__.py').write_text('raise ImportError("made for Python 3.10")\n')
    run = started(name, {'PYTHONPATH': str(tmp_path)})
    text = 'rclpy: ImportError: made for Python 3.10: source only ROS 2 jazzy, in a new terminal'
    assert (run.returncode, run.stdout) == (1, '')
    assert run.stderr == f'epson_driver {name}: {text}\n'


@pytest.mark.slow
@pytest.mark.parametrize('name', [name for name in EXECUTABLES if name not in NEED_ROS])
def test_other_executables_need_no_ros(name: str) -> None:
    changes = {'HOME': '', 'RMW_IMPLEMENTATION': 'rmw_of_another_maker', 'ROS_LOG_DIR': ''}
    run = started(f'{name} --help', changes)
    assert (run.returncode, run.stderr) == (0, '')


@pytest.mark.slow
def test_help_needs_no_log_folder() -> None:
    assert started('demo --help', {'ROS_LOG_DIR': '/dev/null'}).returncode == 0
