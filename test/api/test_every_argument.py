# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every argument of every public method, given what cannot be: one sentence that names it.

Methods and arguments are found by their signatures: a new one is tried, too.
"""

import inspect
from collections.abc import Callable, Iterator
from math import nan
from pathlib import Path
from typing import Any, get_args

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

MADE: dict[str, Callable[..., Any]] = {
    'Robot': aio.Robot,
    'Robot.simulated': aio.Robot.simulated,
    'EpsonPoint': EpsonPoint,
    'GripperWiring': GripperWiring,
    'Settings': Settings,
}

WITHIN = {'begin', 'finish', 'plan', 'simulated'}
"""Methods that no user calls, and one that is among MADE."""

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
"""What the others are given, by the argument's name, or the method's and the argument's."""

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
"""What is of the right kind: whether there is such a thing is found out later."""


def methods() -> Iterator[tuple[str, str]]:
    """Yield the public methods, each with its owner."""
    for owner, kind in OWNERS.items():
        for name, _ in inspect.getmembers(kind, callable):
            if name not in WITHIN and not name.startswith('_'):
                yield owner, name


def arguments(function: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Return the parameters of a function, without self."""
    found = inspect.signature(function).parameters
    return {name: each for name, each in found.items() if name not in ('self', 'cls')}


def given(function: Callable[..., Any], name: str) -> dict[str, Any]:
    """Return arguments that are good."""
    found = {}
    for each, parameter in arguments(function).items():
        key = f'{name}.{each}'
        if key in GOOD or each in GOOD:
            found[each] = GOOD.get(key, GOOD.get(each))
        else:
            assert parameter.default is not parameter.empty, f'{key}: what is a good one?'
    return found


def wrong(parameter: inspect.Parameter) -> Iterator[str]:
    """Yield what cannot be for an argument, by its annotation."""
    kinds = get_args(parameter.annotation) or (parameter.annotation,)
    for what, value in WRONG.items():
        if (value is None and type(None) in kinds) or what == FITS.get(parameter.name):
            continue
        yield what


CASES = [
    (owner, name, argument, what)
    for owner, name in methods()
    for argument, parameter in arguments(getattr(OWNERS[owner], name)).items()
    for what in wrong(parameter)
]


async def asked(method: Callable[..., Any], values: dict[str, Any]) -> Any:
    """Return what a method returns, awaited where it is to be."""
    answer = method(**values)
    return await answer if inspect.isawaitable(answer) else answer


@pytest.fixture(scope='module')
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, ...], object]:
    """Return what each case raised, or returned, and how many frames were sent meanwhile."""
    found: dict[Any, object] = {}

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
                    found[case] = await asked(
                        method, given(method, name) | {argument: WRONG[what]}
                    )
                except Exception as error:  # noqa: BLE001 - the tests look at it
                    found[case] = error
            found['sent'] = link.statistics.frames_sent - sent

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp('here'))
        run(scenario())
    return found


def check_sentence(error: object, argument: str, value: object) -> None:
    """Assert that it is one sentence that names the argument, or shows the value."""
    text = str(error)
    assert isinstance(error, ValueError), repr(error)
    assert '\n' not in text
    assert text.startswith(argument) or f'{argument} =' in text or str(value) in text, text
    assert len(text) < 400


@pytest.mark.parametrize(('owner', 'name'), sorted({case[:2] for case in CASES}))
def test_what_cannot_be_is_a_sentence_that_names_the_argument(
    answers: dict[Any, object], owner: str, name: str
) -> None:
    for case in CASES:
        if case[:2] == (owner, name):
            check_sentence(answers[case], case[2], WRONG[case[3]])
            assert owner == 'point' or isinstance(answers[case], ArgumentError), case


def test_nothing_was_sent(answers: dict[Any, object]) -> None:
    assert answers['sent'] == 0


@pytest.mark.parametrize('name', MADE)
def test_what_cannot_be_made_is_a_sentence_that_names_the_argument(name: str) -> None:
    make = MADE[name]
    good = {} if name.startswith(('Robot', 'Settings')) else given(make, name)
    for argument, parameter in arguments(make).items():
        for what in wrong(parameter):
            with pytest.raises((ValueError, FileNotFoundError)) as caught:
                make(**good | {argument: WRONG[what]})
            if isinstance(caught.value, FileNotFoundError):
                assert str(WRONG[what]) in str(caught.value)
            else:
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
def test_a_robot_that_is_closed_says_so(owner: str, name: str) -> None:
    """Each method needs a connection, and says so, or none, and does what it says."""
    if name in WITHOUT.get(owner, '').split() or name == 'connect' or owner == 'motion':
        return

    async def scenario() -> None:
        async with robot_cell() as (robot, _):
            pass
        method = getattr(robot if owner == 'robot' else getattr(robot, owner), name)
        with pytest.raises(RobotError, match=r'there is no connection|not simulated') as caught:
            await asked(method, given(method, name))
        assert '\n' not in str(caught.value)

    run(scenario())


@pytest.mark.parametrize(
    'name',
    [
        name
        for name, found in inspect.getmembers(aio.Robot)
        if isinstance(found, property) and name not in ('frames', 'model', 'tool')
    ],
)
async def test_what_a_robot_measures_is_not_known_once_it_is_closed(name: str) -> None:
    async with robot_cell() as (robot, _):
        getattr(robot, name)
    with pytest.raises(RobotError, match='there is no connection'):
        getattr(robot, name)
