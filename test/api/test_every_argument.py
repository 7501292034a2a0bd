# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Invalid values for every argument of every public method give one sentence with its name.

Methods and arguments are found by their signatures, so new ones are covered.
"""

import inspect
import re
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.event_loop import run
from support.examples import one_in

from epson_driver import EpsonPoint, GripperWiring, RobotError, Settings, aio
from epson_driver.aio import ArgumentError
from epson_driver.api.simulation import Simulation
from epson_driver.api.threads import LoopThread

HOME = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]
HERE = EpsonPoint(0.0, 300.0, 500.0)
POSE = [0.3, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0]
NEAR = [0.3, 0.1, 0.5, 0.0, 1.0, 0.0, 0.0]
FAR = [1.3, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0]
UP = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
RECORDED = Path(__file__).parents[2] / 'config' / 'trajectories' / 'pick_and_place_20ms.yaml'

OWNERS = {
    'robot': aio.Robot,
    'io': aio.Io,
    'gripper': aio.Gripper,
    'points': aio.Points,
    'simulation': Simulation,
    'motion': aio.Motion,
    'recording': aio.Recording,
    'point': EpsonPoint,
}

CONSTRUCTORS: dict[str, Callable[..., Any]] = {
    'Robot': aio.Robot,
    'Robot.simulated': aio.Robot.simulated,
    'EpsonPoint': EpsonPoint,
    'GripperWiring': GripperWiring,
    'Settings': Settings,
}

WITHIN = {'start', 'finish', 'plan', 'simulated'}
"""Internal methods, and `simulated` from CONSTRUCTORS."""

GOOD: dict[str, Any] = {
    'target': HOME,
    'near': HOME,
    'joints': HOME,
    'points': [HOME],
    'move_path.points': [HERE],
    'times': [9.0],
    'positions': [HOME],
    'servo_velocity.velocities': [0.0] * 6,
    'velocity': [0.0] * 6,
    'pose': HERE,
    'of.pose': np.eye(4),
    'via': [0.3, 0.0, 0.5],
    'recording': str(RECORDED),
    'path': 'no_such.yaml',
    'name': 'here',
    'pose_in.frame': 'base_link',
    'mass': 0.1,
    'factor': 1.0,
    'kind': 'DI',
    'index': 1,
    'value': 0,
    'text': 'clear',
    'distance': 1.0,
    'callback': lambda *_: None,
    'condition': lambda _: True,
    'read': lambda: None,
    'x': 0.0,
    'y': 0.0,
    'z': 0.0,
    'open_output': 0,
    'close_output': 1,
    'opened_input': 2,
    'closed_input': 3,
}
"""Valid values, by argument or by method and argument."""

WRONG: dict[str, Any] = {
    'nothing': None,
    'object': object(),
    'dict': {},
    'text': 'no such thing',
    'NaN': nan,
    'huge': 1e99,
    'complex': 1j,
    'NaNs': [nan] * 6,
    'two': [0.5, 0.5],
    'texts': ['a'] * 6,
    'ragged': [[1.0], [1.0, 2.0]],
}

FITS = {
    **dict.fromkeys(['name', 'path', 'recording', 'error_texts', 'trace_file', 'text'], 'text'),
    'joint_offsets': 'two',
}
"""Invalid values of the right type, by argument: they are rejected only on use."""


MESSAGES: list[tuple[str, Callable[[aio.Robot], Any], str]] = [
    ('degrees', lambda r: r.move_joints([90, 0, 0, 0, 0, 0]), 'look like degrees'),
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
    ('servo far', lambda r: r.servo([1.0, *HOME[1:]]), 'is refused'),
    ('velocities', lambda r: r.servo_velocity([99] * 6), 'above the joint limit'),
    ('servo_pose', lambda r: r.servo_pose(FAR), 'out of reach'),
    ('twist frame', lambda r: r.servo_speed([0] * 6, frame='world'), "frame = 'world'"),
    ('factor', lambda r: r.set_speed_scaling(nan), 'factor = nan: must be 0'),
    ('index', lambda r: r.io.read('DI', -1), 'index = -1'),
    ('no output', lambda r: r.io.write('DI', 3, 1), 'DI'),
    ('tool speed', lambda r: r.set_tool(UP, max_speed=0), 'max_speed = 0'),
    ('mass', lambda r: r.set_payload(-1), 'mass = -1: must be'),
    ('taught name', lambda r: r.points.teach('p3'), "name = 'p3': must be a word"),
    ('no file', lambda r: r.points.load('x.txt'), r'x\.txt: must be a \.pts, a \.csv or a \.yaml'),
]
"""Invalid calls and patterns of their errors."""


def methods() -> Iterator[tuple[str, str]]:
    """Yield the public methods, each with its owner."""
    for owner, kind in OWNERS.items():
        for name, _ in inspect.getmembers(kind, callable):
            if name not in WITHIN and not name.startswith('_'):
                yield owner, name


def arguments(function: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Return the parameters of a function, without self."""
    parameters = inspect.signature(function).parameters
    return {name: value for name, value in parameters.items() if name not in ('self', 'cls')}


def valid_arguments(function: Callable[..., Any], name: str) -> dict[str, Any]:
    """Return valid arguments for all required parameters."""
    results = {}
    for argument_name, parameter in arguments(function).items():
        key = f'{name}.{argument_name}'
        if key in GOOD or argument_name in GOOD:
            results[argument_name] = GOOD.get(key, GOOD.get(argument_name))
        else:
            assert parameter.default is not parameter.empty, f'{key}: add a valid value to GOOD'
    return results


def wrong(parameter: inspect.Parameter) -> Iterator[str]:
    """Yield the names of invalid values for a parameter, by its annotation."""
    optional = re.search('None|Optional', str(parameter.annotation))
    for what, value in WRONG.items():
        if (value is None and optional) or what == FITS.get(parameter.name):
            continue
        yield what


CASES = [
    (owner, name, argument, what)
    for owner, name in methods()
    for argument, parameter in arguments(getattr(OWNERS[owner], name)).items()
    for what in wrong(parameter)
]


async def result_of(method: Callable[..., Any], *given: Any, **values: Any) -> Any:
    """Return the method's result, awaited if needed, or its error."""
    try:
        answer = method(*given, **values)
        return await answer if inspect.isawaitable(answer) else answer
    except Exception as error:  # noqa: BLE001 - checked by the tests
        return error


@pytest.fixture(scope='module')
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, ...], object]:
    """Return each case's error or result, the frames sent, and the arm's displacement."""
    results: dict[Any, object] = {}

    async def scenario() -> None:
        async with robot_cell(enabled=False) as (robot, _):
            await robot.enable()
            owners = {
                **{name: getattr(robot, name, None) for name in OWNERS},
                'robot': robot,
                'motion': await robot.move_joints(HOME),
                'recording': robot.record(),
                'point': HERE,
            }
            link = robot._connection.driver.motion_link
            before, sent = robot.joints, link.statistics.frames_sent
            for case in CASES:
                owner, name, argument, what = case
                method = getattr(owners[owner], name)
                values = valid_arguments(method, name) | {argument: WRONG[what]}
                results[case] = await result_of(method, **values)
            for text, call, _ in MESSAGES:
                results[text] = await result_of(call, robot)
                await robot.servo_end()
            results['sent'] = link.statistics.frames_sent - sent
            results['moved'] = float(np.abs(robot.joints - before).max())

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp('here'))
        run(scenario())
    return results


def check_sentence(error: object, argument: str, value: object) -> None:
    """Assert that the error is one sentence with the argument or the value."""
    text = str(error)
    assert isinstance(error, ValueError), repr(error)
    assert '\n' not in text
    assert text.startswith(argument) or f'{argument} =' in text or str(value) in text, text
    assert len(text) < 400


@pytest.mark.parametrize(('owner', 'name'), sorted({case[:2] for case in CASES}))
def test_invalid_argument_of_every_method_is_named(
    answers: dict[Any, object], owner: str, name: str
) -> None:
    for case in CASES:
        if case[:2] == (owner, name):
            check_sentence(answers[case], case[2], WRONG[case[3]])
            assert isinstance(answers[case], ArgumentError), case


@pytest.mark.parametrize(('name', 'expected'), [(name, text) for name, _, text in MESSAGES])
def test_invalid_call_raises_one_sentence_with_field_and_value(
    answers: dict[Any, object], name: str, expected: str
) -> None:
    error = answers[name]
    assert isinstance(error, RobotError), error
    assert isinstance(error, ArgumentError) or name in ('servo far', 'no output', 'too fast')
    with pytest.raises(RobotError, match=expected):
        raise error
    assert '\n' not in str(error)


def test_invalid_calls_send_nothing(answers: dict[Any, object]) -> None:
    assert answers['moved'] == pytest.approx(0.0, abs=1e-9)
    assert answers['sent'] == 0


def test_unknown_keyword_of_a_blocking_call_raises_and_does_not_hang() -> None:
    with closing(LoopThread('test')) as loop:
        with pytest.raises(TypeError, match='force'):
            loop.run(partial(_close, force=3))  # type: ignore[call-arg]
        assert loop.call(lambda: 7) == 7


async def _close() -> None:
    """Stand for a method of the API, such as `gripper.close`."""


@pytest.mark.parametrize('name', CONSTRUCTORS)
def test_invalid_argument_of_every_constructor_is_named(name: str) -> None:
    make = CONSTRUCTORS[name]
    good = {} if name.startswith(('Robot', 'Settings')) else valid_arguments(make, name)
    for argument, parameter in arguments(make).items():
        for what in wrong(parameter):
            with pytest.raises(ArgumentError) as caught:
                make(**good | {argument: WRONG[what]})
            if not str(caught.value).startswith(('no robot model ', 'no controller profile ')):
                check_sentence(caught.value, argument, WRONG[what])


WITHOUT = {
    'robot': 'close forward inverse on_error on_estop on_joints on_link set_frame set_payload '
    'set_tool',
    'points': 'load save',
    'recording': 'load save stop',
    'point': 'before moved of',
}
"""Methods that need no connection."""


@pytest.mark.parametrize(('owner', 'name'), one_in(4, methods(), several=True))
def test_method_of_a_closed_robot_raises(owner: str, name: str) -> None:
    """Methods listed in WITHOUT are excluded."""
    if name in WITHOUT.get(owner, '').split() or name == 'connect' or owner == 'motion':
        return

    async def scenario() -> None:
        async with robot_cell() as (robot, _):
            pass
        method = getattr(robot if owner == 'robot' else getattr(robot, owner), name)
        error = await result_of(method, **valid_arguments(method, name))
        assert isinstance(error, RobotError)
        assert re.match('.*(no connection|did not start).*$', str(error))

    run(scenario())


@pytest.mark.parametrize(
    'name',
    [
        name
        for name, member in inspect.getmembers(aio.Robot)
        if isinstance(member, property) and name not in ('frames', 'model', 'tool')
    ],
)
async def test_property_of_a_closed_robot_raises(name: str) -> None:
    async with robot_cell() as (robot, _):
        getattr(robot, name)
    with pytest.raises(RobotError, match='no connection'):
        getattr(robot, name)
