# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`demo --plan`, as a newcomer runs it, and when it cannot do what it should."""

import subprocess
import sys
from pathlib import Path

import pytest

from epson_driver.cli.demo_verdict import TOO_BUSY

pytest.importorskip('ompl')  # no wheel for Python 3.14


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=550, check=False
    )


def main_after(code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the demo in a process in which something was done before."""
    words = ['demo', '--plan', *arguments]
    return run(
        '-c',
        f'import sys\n{code}\n'
        f'from epson_driver.cli import demo\nsys.argv = {words!r}\nsys.exit(demo.main())',
    )


@pytest.mark.parametrize('seeds', [1, pytest.param(2, marks=pytest.mark.slow)])
def test_plans_are_executed_and_nothing_collides(tmp_path: Path, seeds: int) -> None:
    picture = tmp_path / 'report.png'
    words = ('demo', '--plan', '--seed', '4', '--seeds', str(seeds), f'--picture={picture}')
    ended = run('-m', 'epson_driver.cli', *words)
    said = ' '.join(ended.stdout.split())
    assert picture.read_bytes().startswith(b'\x89PNG')
    if ended.returncode == TOO_BUSY:  # the simulation was not scheduled, and nobody can tell
        assert 'too busy to judge' in said
        return
    assert ended.returncode == 0, ended.stdout + ended.stderr
    for seed in range(4, 4 + seeds) if seeds > 1 else ():  # it says so of several ones
        assert f'seed {seed}: executed' in said
    assert f'{seeds} of {seeds} executed, none in collision' in said
    rows = [line for line in ended.stdout.splitlines() if 'in order' in line]
    assert len(rows) == seeds


@pytest.mark.slow
@pytest.mark.parametrize('robot', ['gx8_c652s', 'rs6_c552s', 'c8_c901s'])
def test_another_arm_carries_its_part_and_nothing_collides(tmp_path: Path, robot: str) -> None:
    words = ('demo', '--plan', f'--robot={robot}', f'--picture={tmp_path / "report.png"}')
    ended = run('-m', 'epson_driver.cli', *words)
    if ended.returncode == TOO_BUSY:
        return
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert '1 of 1 executed, none in collision' in ' '.join(ended.stdout.split())
    page = (tmp_path / 'report.json').read_text(encoding='utf-8')
    assert f'"robot_model": "{robot}"' in page


def test_without_the_libraries_it_says_how_to_get_them() -> None:
    ended = main_after("sys.modules['ompl'] = None")
    assert ended.returncode == 2
    assert 'ompl' in ended.stdout
    assert "pip install 'epson_driver[planning]'" in ' '.join(ended.stdout.split())


@pytest.mark.slow
def test_a_seed_without_a_plan_is_a_failure_and_the_next_one_is_tried(tmp_path: Path) -> None:
    ended = main_after(
        'from epson_driver.planning import plan\n'
        'real = plan.plan_task\n'
        'def plan_task(task, model, tell):\n'
        '    if task.seed == 1:\n'
        '        raise plan.PlanningError("no way to the part")\n'
        '    return real(task, model, tell)\n'
        'plan.plan_task = plan_task',
        '--seeds=2',
        f'--picture={tmp_path / "report.png"}',
    )
    assert ended.returncode == 1, ended.stdout + ended.stderr
    said = ' '.join(ended.stdout.split())
    assert 'seed 1: no plan: no way to the part' in said
    assert 'seed 2: executed' in said


@pytest.mark.slow
def test_a_collision_that_the_plan_did_not_see_is_a_failure(tmp_path: Path) -> None:
    ended = main_after(
        'from epson_driver.planning import scene\n'
        'scene.Check.valid = lambda self, joints: True\n'
        'from epson_driver.planning import verdict',
        '--seed=5',
        f'--picture={tmp_path / "report.png"}',
    )
    assert ended.returncode == 1, ended.stdout + ended.stderr
    assert 'collided' in ended.stdout
    assert 'pillar' in ended.stdout


def test_point_to_point_motion_is_not_what_was_checked() -> None:
    ended = run('-m', 'epson_driver.cli', 'demo', '--plan', '--compare')
    assert ended.returncode == 2
    assert '--plan is for smooth motion' in ended.stderr


def test_seeds_are_whole_numbers() -> None:
    ended = run('-m', 'epson_driver.cli', 'demo', '--plan', '--seeds=0')
    assert ended.returncode == 2
    assert '--seeds' in ended.stderr
