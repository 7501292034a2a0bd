# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""No executable imports modules of the current folder, which is full of traps."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from epson_driver.demo.run import TOO_BUSY
from epson_driver.processes.command import EXECUTABLES
from epson_driver.processes.processes import free_ros_domain, ros_environment

INSTALLED = (
    'epson_driver',
    'matplotlib',
    'numpy',
    'rclpy',
    'rich',
    'ruckig',
    'websockets',
    'yaml',
)
TRAP = """
import os
with open(os.path.join(os.path.dirname(__file__), 'PWNED'), 'a') as file:
    print(__name__, file=file)
raise ImportError('the trap ' + __name__)
"""


def trap_folder(parent: Path) -> Path:
    """Return a new folder with a module for each standard module and dependency."""
    folder = parent / 'traps'
    folder.mkdir()
    for name in {*sys.stdlib_module_names, *INSTALLED, 'sitecustomize', 'usercustomize'}:
        (folder / f'{name}.py').write_text(TRAP, encoding='utf-8')
    return folder


def sprung(folder: Path) -> str:
    """Return the executed modules, one per line."""
    record = folder / 'PWNED'
    return record.read_text(encoding='utf-8') if record.exists() else ''


pytestmark = pytest.mark.invariant(7)

LAUNCHERS = Path(sys.prefix) / 'lib' / 'epson_driver'
OFTEN = ('client', 'smooth_goals', 'report', 'spel')
"""Executables whose usage is printed in test-rest. The others have the same launcher."""

PROGRAM = Path(__file__).parents[1] / 'exercise' / 'programs' / 'good.py'
FREE = [f'--{port}-port=0' for port in ('motion', 'state', 'io', 'remote')]
MOVE = """
from epson_driver import Robot
with Robot.simulated() as robot:
    robot.enable()
    robot.move_joints([0.05] * 6)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder of modules that record their import, which must not happen."""
    made = trap_folder(tmp_path)
    yield made
    assert sprung(made) == ''


def started(folder: Path, name: str, *arguments: str) -> subprocess.Popen[str]:
    """Start an executable of `ros2 run`, or another program."""
    return subprocess.Popen(
        [str(LAUNCHERS / name), *arguments],
        cwd=folder,
        env=ros_environment(free_ros_domain()) | {'MPLBACKEND': 'agg'},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(process: subprocess.Popen[str], *codes: int) -> str:
    output, errors = process.communicate(timeout=550)
    assert process.returncode in (codes or (0,)), output + errors
    return output


@pytest.mark.parametrize(
    'name',
    [
        name if name in OFTEN else pytest.param(name, marks=pytest.mark.soak)
        for name in EXECUTABLES
    ],
)
def test_executable_prints_its_usage(folder: Path, name: str) -> None:
    assert ended(started(folder, name, '--help')).startswith(f'usage: epson_driver {name} ')


def test_simulated_controller_starts_with_its_planner(folder: Path) -> None:
    process = started(folder, 'sim_controller', *FREE)
    assert process.stdout is not None
    assert process.stdout.readline().startswith('listening ')
    process.send_signal(signal.SIGTERM)
    ended(process)


def test_program_moves_a_simulated_robot(folder: Path) -> None:
    ended(started(folder, sys.executable, '-P', '-c', MOVE))


@pytest.mark.parametrize(
    'words',
    [
        pytest.param(['demo'], marks=pytest.mark.soak),
        ['exercise', '--fault=pause', '--timeout=150', '--', sys.executable, str(PROGRAM)],
    ],
    ids=lambda words: words[0],
)
def test_tools_that_start_processes_work(folder: Path, words: list[str]) -> None:
    ended(started(folder, *words), 0, TOO_BUSY)


def test_panel_starts_with_the_simulated_controller(folder: Path) -> None:
    pytest.importorskip('websockets')
    process = started(folder, 'sim_controller', *FREE, '--panel')
    assert process.stdout is not None
    while not process.stdout.readline().startswith('panel'):
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    ended(process)
