# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The programs of examples/ run as they are, and print what they announce."""

import os
import re
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from support.api_harness import output, program
from support.cell import Cell

EXAMPLES = Path(__file__).parents[2] / 'examples'

PYTHON = {
    'camera_points.py': 'over the part at',
    'first_motion.py': 'at the goal',
    'log_joints.py': 'joints.csv has rows',
    'nothing_loaded.py': 'DI 0 is 0',
    'pick_and_place.py': '4 parts moved',
    'record_and_replay.py': 'at the goal',
    'recover_from_estop.py': 'arrived',
    'rounded_path.py': 'at the goal',
    'stream_sine.py': 'the arm is at rest',
    'taught_points.py': 'EpsonPoint(x=30',
    'two_robots.py': 'both at 0.0 rad',
    'wait_for_part.py': 'DO 5 is 1',
}
"""A part of the output of each program that needs neither ROS nor hardware."""

OTHERS = {
    'lerobot_policy.py',
    'moveit_goal.py',
    'ros_goal.py',
    'ros_watch.py',
    'stream_joystick.py',
}
"""The first two run in the tests of lerobot's plugin and in test_genuine_ros.py."""


def test_every_example_is_in_the_table_and_tested() -> None:
    names = {path.name for path in EXAMPLES.glob('*.py')}
    assert names == set(PYTHON) | OTHERS
    page = (EXAMPLES / 'README.md').read_text(encoding='utf-8')
    assert set(re.findall(r'\((\w+\.py)\)', page)) == names


@pytest.mark.parametrize(
    'name',
    [
        pytest.param(name, marks=() if name == 'first_motion.py' else pytest.mark.slow)
        for name in PYTHON
    ],
)
def test_example_moves_a_simulated_arm(name: str, tmp_path: Path) -> None:
    code = (EXAMPLES / name).read_text(encoding='utf-8')
    assert PYTHON[name] in output(program(code, cwd=tmp_path))


@pytest.mark.slow
def test_joystick_moves_the_arm_until_the_button(tmp_path: Path) -> None:
    device = tmp_path / 'js0'
    os.mkfifo(device)
    code = (EXAMPLES / 'stream_joystick.py').read_text(encoding='utf-8')
    shown = code.replace('time.sleep(0.02)', 'time.sleep(0.02); print(robot.ros_pose[0])')
    assert shown != code
    process = program(shown, device, cwd=tmp_path)
    assert process.stdout is not None
    with device.open('wb', buffering=0) as stick:
        start = float(process.stdout.readline())
        stick.write(struct.pack('<IhBB', 0, 20000, 2, 0))
        while float(process.stdout.readline()) < start + 0.005:
            pass
        stick.write(struct.pack('<IhBB', 0, 1, 1, 0))
        assert 'the arm is at rest' in output(process)


@pytest.mark.slow
def test_ros_examples_move_and_watch_the_arm(shared_cell: Cell, tmp_path: Path) -> None:
    def run(name: str) -> 'subprocess.Popen[str]':
        return subprocess.Popen(
            [sys.executable, EXAMPLES / name],
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {'ROS_DOMAIN_ID': str(shared_cell.domain)},
        )

    assert '0 at the goal' in output_of(run('ros_goal.py'))
    watch = run('ros_watch.py')
    assert watch.stdout is not None
    assert 'motion possible 1' in watch.stdout.readline()
    watch.terminate()
    watch.communicate(timeout=60)


def output_of(process: 'subprocess.Popen[str]') -> str:
    text, _ = process.communicate(timeout=300)
    assert process.returncode == 0
    return text
