# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Invalid arguments give a one-line error and send nothing."""

import inspect
from contextlib import closing
from functools import partial

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.event_loop import run

from epson_driver.aio import ArgumentError, RobotError
from epson_driver.api.threads import LoopThread

NAN, INF = float('nan'), float('inf')
HOME = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]
POSE = [0.3, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0]
NEAR = [0.3, 0.1, 0.5, 0.0, 1.0, 0.0, 0.0]
FAR = [1.3, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0]
UP = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]

CASES = [
    ('degrees', lambda r: r.move_joints([90, 0, 0, 0, 0, 0]), 'look like degrees'),
    ('NaN', lambda r: r.move_joints([NAN] * 6), 'target: joint_1 = nan: must be a finite'),
    ('five joints', lambda r: r.move_joints([0] * 5), r'shape \(5,\): must be \(6,\)'),
    (
        'out of range',
        lambda r: r.move_joints([3, *HOME[1:]]),
        'position 3 rad is outside',
    ),
    ('speed', lambda r: r.move_joints(HOME, speed=2), r'speed = 2.*\(0, 1\]'),
    ('no points', lambda r: r.move_waypoints([]), 'points has shape'),
    ('times', lambda r: r.move_trajectory([2, 1], [HOME] * 2), 'must strictly increase'),
    ('31 years', lambda r: r.move_trajectory([1e9], [HOME]), r'1e\+09 s: must be 86400 s'),
    ('slow', lambda r: r.move_joints([0.1, *HOME[1:]], speed=1e-8), r'at most \d+ s \(100000 po'),
    ('slow line', lambda r: r.move_line(NEAR, speed=1e-5), r'at most 5000 s \(100000 points'),
    ('too fast', lambda r: r.move_trajectory([0.001], [[1.0, *HOME[1:]]]), 'joint_1'),
    ('out of reach', lambda r: r.move_line(FAR), 'out of reach'),
    ('pose', lambda r: r.move_joints(FAR), 'out of reach'),
    ('name', lambda r: r.move_line('pick'), r'pose = .pick.: .* is robot.points.name'),
    ('home', lambda r: r.move_joints('home'), r'target = .home.: .* is robot.points.name'),
    ('inverse', lambda r: r.inverse(FAR), 'out of reach'),
    ('mm', lambda r: r.move_line([300, 0, 500, *POSE[3:]]), 'positions are in m'),
    ('mm/s', lambda r: r.move_line(POSE, speed=250), 'speed = 250: must be .* to 100 m/s'),
    ('accuracy', lambda r: r.move_line(POSE, accuracy=0), 'accuracy = 0'),
    ('path', lambda r: r.move_path([POSE, FAR]), 'out of reach'),
    ('servo', lambda r: r.servo([NAN] * 6), 'joint_1 = nan'),
    ('servo far', lambda r: r.servo([1.0, *HOME[1:]]), 'is refused'),
    ('velocities', lambda r: r.servo_velocity([99] * 6), 'above the joint limit'),
    ('servo_pose', lambda r: r.servo_pose(FAR), 'out of reach'),
    ('twist', lambda r: r.servo_speed([0] * 5), r'velocity has shape \(5,\)'),
    ('twist frame', lambda r: r.servo_speed([0] * 6, frame='world'), "frame = 'world'"),
    ('factor', lambda r: r.set_speed_scaling(NAN), 'factor = nan: must be 0'),
    ('kind', lambda r: r.io.read('XX', 0), "kind = 'XX': must be DI"),
    ('index', lambda r: r.io.read('DI', -1), 'index = -1'),
    ('no output', lambda r: r.io.write('DI', 3, 1), 'DI'),
    ('timeout', lambda r: r.wait_for_input(3, timeout='x'), "timeout = 'x'"),
    ('tool speed', lambda r: r.set_tool(UP, max_speed=0), 'max_speed = 0'),
    ('mass', lambda r: r.set_payload(-1), 'mass = -1: must be'),
    ('taught name', lambda r: r.points.teach('p3'), "name = 'p3': must be a word"),
    ('no name', lambda r: r.points.teach(None), 'name = null: must be a string|name = None'),
    ('no point', lambda r: r.points.__setitem__('a', 3), 'point = 3: must be EpsonPoint'),
    ('no file', lambda r: r.points.load('x.txt'), r'x\.txt: must be a \.pts, a \.csv or a \.yaml'),
    ('input', lambda r: r.simulation.input(3, 'x'), "value = 'x'"),
]


async def result_of(robot, ask):
    """Return the result of a call, awaited if needed."""
    answer = ask(robot)
    return await answer if inspect.isawaitable(answer) else answer


@pytest.fixture(scope='module')
def answers():
    """Return each case's error or result, the arm's displacement and the frames sent."""
    results = {}

    async def scenario():
        async with robot_cell(enabled=False) as (robot, controller):
            await robot.enable()
            await robot.move_joints(HOME)
            driver = robot._connection.driver
            before, sent = robot.joints, driver.motion_link.statistics.frames_sent
            for name, ask, _ in CASES:
                try:
                    results[name] = await result_of(robot, ask)
                except Exception as error:  # noqa: BLE001 - checked by the tests
                    results[name] = error
                await robot.servo_end()
            assert controller
            results['moved'] = np.abs(robot.joints - before).max()
            results['sent'] = driver.motion_link.statistics.frames_sent - sent

    run(scenario())
    return results


@pytest.mark.parametrize(('name', 'expected'), [(name, expected) for name, _, expected in CASES])
def test_invalid_argument_raises_one_sentence_with_field_and_value(answers, name, expected):
    error = answers[name]
    assert isinstance(error, RobotError), error
    assert isinstance(error, ArgumentError) or name in ('servo far', 'no output', 'too fast')
    with pytest.raises(RobotError, match=expected):
        raise error
    assert '\n' not in str(error)


def test_invalid_arguments_send_nothing(answers):
    assert answers['moved'] == pytest.approx(0.0, abs=1e-9)
    assert answers['sent'] == 0


def test_unknown_keyword_of_a_blocking_call_raises_and_does_not_hang():
    with closing(LoopThread('test')) as loop:
        with pytest.raises(TypeError, match='force'):
            loop.run(partial(_close, force=3))
        assert loop.call(lambda: 7) == 7


async def _close():
    """Stand for a method of the API, such as `gripper.close`."""
