# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The examples of docs/python.md run unchanged, without any ROS package."""

import re
from pathlib import Path

import pytest
from support.api_harness import output, program
from support.examples import one_in

PAGE = (Path(__file__).parents[2] / 'docs' / 'python.md').read_text(encoding='utf-8')
EXAMPLES = re.findall(r'(?ms)^```python\n(.*?)^```', PAGE)

EXPECTED = (
    'the arm is enabled',
    'open http',
    'the running motion ended: ',
    'canceled, the arm is at rest',
    'out of reach',
    '[0. 0. 0.]',
    'True',
    'no stream is followed, and the arm is at rest',
    'link disconnected',
    ' rad\n',
)
"""A part of each example's output."""


def test_every_example_has_an_expected_output() -> None:
    assert len(EXAMPLES) == len(EXPECTED)


@pytest.mark.parametrize(
    ('code', 'expected'),
    [
        pytest.param(*item, marks=[pytest.mark.slow] if number else [], id=str(number))
        for number, item in enumerate(zip(EXAMPLES, EXPECTED, strict=True))
    ],
)
def test_example_runs_without_ros(code: str, expected: str, tmp_path: Path) -> None:
    assert expected in output(program(code, cwd=tmp_path))


@pytest.mark.parametrize('module', one_in(3, ['rclpy', 'sensor_msgs.msg', 'control_msgs.action']))
def test_ros_import_fails_in_example_processes(module: str) -> None:
    process = program(f'import {module}')
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 1
    assert 'no ROS here' in errors


@pytest.mark.parametrize(
    'words',
    one_in(
        7,
        [
            ('robots',),
            ('robots', 'c3_a601s'),
            ('sim_controller', '--help'),
            ('pendant', '--help'),
            ('smooth', '--help'),
            ('spel', '--help'),
        ],
    ),
    ids=' '.join,
)
def test_command_line_tools_run_without_ros(words: tuple[str, ...]) -> None:
    code = f"""
import sys
from epson_driver.cli.__main__ import main
sys.argv = ['epson_driver', *{words!r}]
sys.exit(main())
"""
    assert output(program(code))
