# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The demo, run like by a user."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from support.here import run_here

from epson_driver.cli import demo as command
from epson_driver.demo.run import TOO_BUSY
from epson_driver.share import share_path


def demo(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-m', 'epson_driver.cli', 'demo', *arguments],
        capture_output=True,
        text=True,
        timeout=550,
        check=False,
    )


def assert_judged(run: subprocess.CompletedProcess[str]) -> None:
    """Assert that the plan was executed, or that the machine was too busy to judge."""
    assert run.returncode in (0, TOO_BUSY), run.stdout + run.stderr
    verdict = 'too busy to judge' if run.returncode else 'the arm followed the plan'
    assert verdict in ' '.join(run.stdout.split())


def test_demo_executes_the_plan_and_writes_a_report(tmp_path: Path) -> None:
    picture = tmp_path / 'report.png'
    run = demo(f'--picture={picture}')
    assert_judged(run)
    if run.returncode and not picture.exists():  # too busy: nothing to draw
        return
    assert picture.read_bytes().startswith(b'\x89PNG')
    assert 'Content-Security-Policy' in picture.with_suffix('.html').read_text(encoding='utf-8')
    (motion,) = json.loads(picture.with_suffix('.json').read_text(encoding='utf-8'))['motions']
    assert motion['points'] == 11
    assert motion['dead_time_s'] > 0.0
    if not run.returncode:
        assert motion['stops'] == 0
        assert motion['waypoint_deviation'] < 0.02


def test_demo_runs_a_scara(tmp_path: Path) -> None:
    picture = tmp_path / 'arm.png'
    run = demo('--robot=t6_b602s', '--controller=simulated', f'--picture={picture}')
    assert_judged(run)
    assert re.search(r'highest velocity.* rad/s, 0\.\d+ m/s', run.stdout)
    figures = json.loads(picture.with_suffix('.json').read_text(encoding='utf-8'))
    assert figures['robot_model'] == 't6_b602s'
    assert run.returncode or figures['motions'][0]['stops'] == 0


def test_demo_compares_the_spel_and_the_built_in_program(tmp_path: Path) -> None:
    picture = tmp_path / 'both.png'
    run = demo('--controller=spel', '--compare', f'--picture={picture}')
    assert_judged(run)
    assert 'SPEL+ program' in run.stdout
    if run.returncode and not picture.exists():  # too busy: nothing to draw
        return
    figures = json.loads(picture.with_suffix('.json').read_text(encoding='utf-8'))
    sources = [run['source'] for run in figures]
    assert sources == ['demo, smooth', 'demo, SPEL+ program']
    assert all(len(run['motions']) == 1 for run in figures)


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--controller=spel', '--motion=ptp'], '--motion: its statements determine'),
        (['--controller=rc1'], 'no controller profile rc1'),
        (['--robot=gx9'], 'no robot model gx9'),
    ],
)
def test_demo_rejects_invalid_arguments(arguments: list[str], words: str) -> None:
    run = run_here(command.main, *arguments)
    assert run.returncode == 2
    assert words in run.stderr


def test_demo_reports_an_invalid_file(tmp_path: Path) -> None:
    missing = demo('--trajectory', str(tmp_path / 'none.yaml'))
    assert missing.returncode == 1
    assert 'none.yaml' in missing.stdout.replace('\n', '')  # wrapped at the terminal's width
    plan = share_path('config', 'trajectories', 'around_pillar_11_points.yaml')
    bad = tmp_path / 'bad.yaml'
    text = plan.read_text(encoding='utf-8')
    bad.write_text(text.replace('-0.212831978', '-3.212831978'), encoding='utf-8')
    run = demo('--trajectory', str(bad), f'--picture={tmp_path / "bad.png"}')
    assert run.returncode == 1
    words = ' '.join(run.stdout.split())
    assert 'point 4' in words
    assert 'joint_1' in words
    assert '-2.96706' in words
    page = (tmp_path / 'bad.html').read_text(encoding='utf-8')  # report of the motion before
    assert 'Content-Security-Policy' in page


def test_demo_compares_smooth_and_point_to_point(tmp_path: Path) -> None:
    picture = tmp_path / 'both.png'
    run = demo('--compare', f'--picture={picture}')
    assert_judged(run)
    assert '1 of 2: point to point' in run.stdout
    assert '2 of 2: smooth' in run.stdout
    (stops,) = (line for line in run.stdout.splitlines() if 'intermediate stops' in line)
    at_points, smooth = (int(cell) for cell in stops.split('│')[2:4])
    assert (at_points, smooth) == (9, 0) or run.returncode == TOO_BUSY
    assert picture.read_bytes().startswith(b'\x89PNG')
    both = json.loads(picture.with_suffix('.json').read_text(encoding='utf-8'))
    assert [motion['source'] for motion in both] == ['demo, point to point', 'demo, smooth']
    if not run.returncode:
        assert [motion['motions'][0]['stops'] for motion in both] == [9, 0]
