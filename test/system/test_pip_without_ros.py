# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The source distribution in an environment without any ROS package."""

import os
import re
import subprocess
import sys
import tarfile
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PYTHON_PAGE = (ROOT / 'docs' / 'python.md').read_text(encoding='utf-8')
(FIRST, *_) = re.findall(r'(?ms)^```python\n(.*?)^```', PYTHON_PAGE)
MEGABYTE = 1e6
LARGEST_MB = 110
"""Maximum size added to an empty environment, with byte code (docs/python.md)."""

USER = """
import asyncio

from epson_driver import GripperWiring, MotionError, Robot, RobotError, Settings
from epson_driver.aio import Robot as AsyncRobot


def go(robot: Robot) -> float:
    try:
        motion = robot.move_joints([0.0] * 6, speed=0.5, wait=False)
        text: str = motion.wait(5.0)
        print(text, motion.progress, robot.status.remedy)
    except MotionError as error:
        print(error.code, error.end)
    except RobotError as error:
        print(error)
    remove = robot.on_estop(lambda pressed: print('E-stop', pressed))
    remove()
    value: int = robot.io.read('DI', 3)
    return float(robot.joints[value])


async def main() -> None:
    wiring = GripperWiring(open_output=0, close_output=1, opened_input=0, closed_input=1)
    async with AsyncRobot.simulated(settings=Settings(gripper=wiring)) as robot:
        await robot.enable()
        await robot.move_trajectory([1.0], [[0.0] * 6])
        opened: bool = (await robot.gripper.open()).opened
        print(opened)


if __name__ == '__main__':
    with Robot.simulated() as simulated:
        go(simulated)
    asyncio.run(main())
"""

LINE = """
from epson_driver import Robot

with Robot.simulated(start=[0.0, 0.2, 0.2, 0.0, -1.9, 0.0]) as robot:
    robot.enable()
    print(robot.move_line([0.0, 0.02, 0.0, 0.0, 0.0, 0.0, 1.0], frame='tool').text)
"""


def run(*words: object, where: Path) -> subprocess.CompletedProcess[str]:
    """Run a command outside the source tree, without this Python environment."""
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith('PYTHON')
    }
    return subprocess.run(
        [str(word) for word in words],
        cwd=where,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


def size_mb(folder: Path) -> float:
    """Return the size of all files in a folder, MB."""
    files = (path for path in folder.rglob('*') if path.is_file())
    return sum(path.lstat().st_size for path in files) / MEGABYTE


@pytest.fixture(scope='module')
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the source distribution."""
    folder = tmp_path_factory.mktemp('sdist')
    build = 'import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])'
    subprocess.run(
        [sys.executable, '-c', build, folder], cwd=ROOT, check=True, capture_output=True
    )
    (archive,) = folder.glob('*.tar.gz')
    return archive


@pytest.fixture(scope='module')
def python(sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the interpreter of a new environment with this package and its requirements."""
    folder = tmp_path_factory.mktemp('without_ros')
    venv.EnvBuilder(with_pip=True, symlinks=True).create(folder / 'env')
    (folder / 'empty').write_text(str(size_mb(folder / 'env')))
    interpreter = folder / 'env' / 'bin' / 'python'
    # without hashes, because pip demands all or none, and the local archive has none
    pinned = (ROOT / 'requirements' / 'constraints.txt').read_text(encoding='utf-8')
    constraints = folder / 'constraints.txt'
    constraints.write_text(re.sub(r' \\\n\s+--hash=\S+', '', pinned), encoding='utf-8')
    made = run(interpreter, '-m', 'pip', 'install', '-q', '-c', constraints, sdist, where=folder)
    if 'No matching distribution' in made.stderr or 'Failed to establish' in made.stderr:
        pytest.skip(f'no package index: {made.stderr[-300:]}')
    assert made.returncode == 0, made.stderr
    return interpreter


def test_source_distribution_contains_no_tests(sdist: Path) -> None:
    with tarfile.open(sdist) as archive:
        tops = {name.split('/')[1] for name in archive.getnames() if '/' in name}
    assert {'epson_driver', 'config', 'urdf', 'README.md', 'LICENSE'} <= tops
    assert 'test' not in tops


def test_installation_is_small_and_without_ros(python: Path) -> None:
    listed = run(python, '-m', 'pip', 'list', '--format=freeze', where=python.parent).stdout
    names = {line.partition('==')[0].lower() for line in listed.splitlines()}
    assert 'epson_driver' in names or 'epson-driver' in names
    assert not [name for name in names if name.startswith('ros') or name.endswith('msgs')]
    empty = float((python.parents[2] / 'empty').read_text())
    assert size_mb(python.parents[1]) - empty < LARGEST_MB


def test_six_axis_arm_moves_on_a_line_without_extras(python: Path) -> None:
    ran = run(python, '-c', LINE, where=python.parent)
    assert ran.returncode == 0, ran.stderr
    assert 'at the goal' in ran.stdout


def test_first_example_of_the_docs_runs(python: Path) -> None:
    ran = run(python, '-c', FIRST, where=python.parent)
    assert ran.returncode == 0, ran.stderr
    assert 'the arm is enabled' in ran.stdout


def test_smooth_writes_the_motion_and_names_the_missing_extra(
    python: Path, tmp_path: Path
) -> None:
    plan = tmp_path / 'plan.yaml'
    plan.write_text(
        'joint_names: [joint_1, joint_2, joint_3, joint_4, joint_5, joint_6]\n'
        'points:\n'
        '- {positions: [0, 0, 0, 0, 0, 0], time_from_start: 0}\n'
        '- {positions: [0.3, 0.1, 0, 0, 0, 0], time_from_start: 1.0}\n'
        '- {positions: [0.5, 0, 0, 0, 0, 0], time_from_start: 2.0}\n'
    )
    ran = run(python.with_name('epson_driver'), 'smooth', plan, where=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert (tmp_path / 'plan_smooth.yaml').is_file()
    assert "pip install 'epson_driver[report]'" in ' '.join(ran.stdout.split())


@pytest.mark.parametrize('name', ['client', 'demo'])
def test_tools_that_need_ros_name_the_missing_module(python: Path, name: str) -> None:
    ran = run(python.with_name('epson_driver'), name, where=python.parent)
    assert ran.returncode == 1
    (line,) = ran.stderr.splitlines()
    assert line.startswith(f'epson_driver {name}: the Python module ')
    assert 'pip install' in line


WRONG = """
from epson_driver import Robot

with Robot.simulated() as robot:
    reveal_type(robot)
    robot.move_joint([0.0])
    robot.on_link(3)
    robot.move_line([0.0], sped=1.0)
    robot.move_joints([0.0] * 6, speed='fast')
"""
MESSAGES = (
    'note: Revealed type is "epson_driver.robot.Robot"',
    'error: "Robot" has no attribute "move_joint"',
    'error: Argument 1 has incompatible type "int"; expected "Callable[[str, str]',
    'error: Unexpected keyword argument "sped"',
    'error: Argument "speed" has incompatible type "str"; expected "float"',
)


def test_user_s_file_passes_mypy_strict(python: Path, tmp_path: Path) -> None:
    """mypy checks against the installed package with its py.typed."""
    file, wrong = tmp_path / 'user.py', tmp_path / 'wrong.py'
    file.write_text(USER, encoding='utf-8')
    wrong.write_text(WRONG, encoding='utf-8')
    words = ['-m', 'mypy', '--strict', '--cache-dir', tmp_path / 'cache']
    ran = run(sys.executable, *words, '--python-executable', python, file, wrong, where=tmp_path)
    lines = [line for line in ran.stdout.splitlines() if '.py:' in line]
    for line, message in zip(lines, MESSAGES, strict=True):
        assert line.startswith('wrong.py')
        assert message in line
