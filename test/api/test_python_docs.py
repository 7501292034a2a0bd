# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The examples of docs/python.md run as they are, where nothing of ROS can be imported."""

import re
from pathlib import Path

import pytest
from support.api_harness import output, program
from support.examples import one_in

PAGE = (Path(__file__).parents[2] / 'docs' / 'python.md').read_text(encoding='utf-8')
EXAMPLES = re.findall(r'(?ms)^```python\n(.*?)^```', PAGE)

SAID = (
    'the arm is enabled',
    'the running motion ended: ',
    'canceled; the arm stands',
    'out of reach',
    '[0. 0. 0.]',
    'True',
    'no stream is followed, and the arm stands',
    'link disconnected',
    '0.4',
)
"""What each example prints among other things."""


def test_every_example_is_here() -> None:
    assert len(EXAMPLES) == len(SAID)


NONE = None
"""A peer that cannot do it, or takes a loop of one's own for it."""

TASKS = {
    'connect': (('with Robot.simulated(start=HOME',), 4, 2, 1),
    'home': (("robot.move_joints(robot.points['home'])",), 1, 1, 1),
    'joints': (('robot.move_joints([0.1',), 1, 1, 1),
    'relative line': (('robot.move_line([0.0, 0.0, 0.02',), 1, 3, 1),
    'arc': (('robot.move_arc(',), 1, 3, NONE),
    'path': (('robot.move_path(',), 2, 1, 2),
    'TCP': (('robot.set_tool(',), 1, 1, 1),
    'payload': (('robot.set_payload(',), 1, 1, NONE),
    'gripper': (('print(robot.gripper.open()',), 1, 1, 1),
    'wait for an input': (('robot.wait_for_input(',), 2, 2, 2),
    'pose': (('print(robot.ros_pose',), 1, 1, 1),
    'speed while it moves': (('robot.set_speed_scaling(0.5)',), NONE, 1, NONE),
    'pause': (('robot.set_speed_scaling(0)',), 1, 1, 1),
    'stop': (('print(robot.stop())',), 1, 1, 1),
    'recover': (('print(robot.reset(enable=True))',), 4, 2, 1),
    'teach': (('recording = robot.record()', 'robot.replay(recording)'), 3, NONE, 3),
    'record at 100 Hz': (('log = robot.record(rate=100.0)', "log.save('"), NONE, 2, NONE),
}
"""Each task: how its lines begin in the page, and how many xArm's SDK 1.18, ur_rtde 1.6 and
pymycobot take at least, by their examples and references. Imports, waits, what is given as data,
and a person's hand at the controller do not count for anybody. Teach: and replay."""


@pytest.mark.parametrize('task', TASKS)
def test_an_everyday_task_takes_no_more_lines_than_with_other_libraries(task: str) -> None:
    ours, *others = TASKS[task]
    assert len(ours) <= min(lines for lines in others if lines)
    said = [line.strip() for line in EXAMPLES[1].splitlines()]
    begun = [[line for line in said if line.startswith(each)] for each in ours]
    assert all(len(lines) == 1 for lines in begun)
    assert re.search(rf'[):]  # {task}\b', begun[0][0])


@pytest.mark.parametrize(
    ('code', 'said'),
    [
        pytest.param(*each, marks=[pytest.mark.slow] if number else [], id=str(number))
        for number, each in enumerate(zip(EXAMPLES, SAID, strict=True))
    ],
)
def test_the_example_runs_without_ros(code: str, said: str, tmp_path: Path) -> None:
    assert said in output(program(code, cwd=tmp_path))


@pytest.mark.parametrize('module', one_in(3, ['rclpy', 'sensor_msgs.msg', 'control_msgs.action']))
def test_ros_really_cannot_be_imported_there(module: str) -> None:
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
def test_executables_that_need_no_ros_run_without_it(words: tuple[str, ...]) -> None:
    code = f"""
import sys
from epson_driver.cli.__main__ import main
sys.argv = ['epson_driver', *{words!r}]
sys.exit(main())
"""
    assert output(program(code))
