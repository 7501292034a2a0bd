# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Invalid values for every argument of every public method give one sentence with its name.

Methods and arguments are found by their signatures, so new ones are covered.
"""

import inspect
import re
from collections.abc import Callable, Iterator
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

HOME = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]
HERE = EpsonPoint(0.0, 300.0, 500.0)
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


async def result_of(method: Callable[..., Any], values: dict[str, Any]) -> Any:
    """Return the method's result, awaited if needed."""
    answer = method(**values)
    return await answer if inspect.isawaitable(answer) else answer


@pytest.fixture(scope='module')
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, ...], object]:
    """Return each case's error or result, and the number of frames sent."""
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
            sent = link.statistics.frames_sent
            for case in CASES:
                owner, name, argument, what = case
                method = getattr(owners[owner], name)
                try:
                    results[case] = await result_of(
                        method, valid_arguments(method, name) | {argument: WRONG[what]}
                    )
                except Exception as error:  # noqa: BLE001 - checked by the tests
                    results[case] = error
            results['sent'] = link.statistics.frames_sent - sent

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


def test_invalid_method_arguments_send_nothing(answers: dict[Any, object]) -> None:
    assert answers['sent'] == 0


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
        with pytest.raises(RobotError, match=r'no connection|did not start') as caught:
            await result_of(method, valid_arguments(method, name))
        assert '\n' not in str(caught.value)

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
