# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The Python API and the node configure the driver equally."""

import ast
import dataclasses
import typing
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from support.longer_arm import arm_file

from epson_driver import Robot, Settings, aio, driver
from epson_driver.api.errors import WORDS, ArgumentError
from epson_driver.driver.remedy import Remedy
from epson_driver.setup.setup import make_setup
from epson_driver.setup.table import GOAL_TOLERANCE
from epson_driver.simple_message import ByteOrder

PROFILES = ['simulated', 'spel', 'generic', 'fanuc', 'abb', 'motoman']


def flat(value):
    """Return a configuration's fields in comparable form."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if dataclasses.is_dataclass(value):
        return {
            field.name: flat(getattr(value, field.name)) for field in dataclasses.fields(value)
        }
    return value


@pytest.mark.parametrize('name', PROFILES)
@pytest.mark.parametrize('model', ['c3_a601s', 'gx4_c251s'])
def test_robot_has_the_configuration_of_the_node_with_default_parameters(name, model):
    setup = aio.Robot(controller=name, model=model)._setup
    node = make_setup({'controller': name, 'robot_model': model})
    assert flat(setup.configuration) == flat(node.configuration)
    assert setup.goals == node.goals
    assert setup.servo == node.servo
    units = setup.model.limits.units
    assert list(setup.tolerances('goal').position) == [GOAL_TOLERANCE[unit] for unit in units]


def test_types_of_the_settings_have_the_choices_of_their_parameters():
    hints = typing.get_type_hints(Settings)
    for field in dataclasses.fields(Settings):
        choices = getattr(field.metadata.get('row'), 'choices', ())
        kinds = [hints[field.name], *typing.get_args(hints[field.name])]
        named = [typing.get_args(kind) for kind in kinds if typing.get_origin(kind) is Literal]
        assert named == ([choices] if choices else []), field.name


def test_each_setting_reaches_its_parameter():
    changed = {
        'joint_signs': (-1,),
        'joint_offsets': (0.5,),
        'j23_factor': 1,
        'error_texts': 'none',
        'byte_order': 'big',
        'state_timeout': 2.0,
        'io_timeout': 2.5,
        'reply_timeout': 3.0,
        'start_tolerance': 0.03,
        'goal_tolerance': 0.04,
        'goal_time': 6.0,
        'stopped_velocity_tolerance': 0.07,
        'require_planned_speed': False,
        'servo_scale': 0.5,
        'servo_timeout': 0.2,
        'trace_file': 'traces/one.pcap',
    }
    setup = aio.Robot(settings=Settings(**changed))._setup
    for name in ('state_timeout', 'io_timeout', 'reply_timeout', 'start_tolerance', 'byte_order'):
        assert setup.values[name] == changed[name]
    assert setup.configuration.byte_order == ByteOrder.BIG
    assert setup.values['joint_signs'] == [-1]
    assert setup.goals.stopped_velocity == 0.07
    assert not setup.goals.require_planned_speed
    assert (setup.servo.scale, setup.servo.timeout) == (0.5, 0.2)
    assert list(setup.tolerances('goal').position) == [0.04] * 6
    assert setup.values['constraints.goal_time'] == 6.0
    assert (setup.values['trace_folder'], setup.values['trace_file']) == ('traces', 'one.pcap')


@pytest.mark.parametrize(
    ('arguments', 'expected'),
    [
        ({'motion_port': 0}, 'motion_port = 0: must be a whole number from 1'),
        ({'io_port': 70000}, 'io_port = 70000'),
        ({'state_port': '11002'}, "state_port = '11002'"),
        ({'host': 'no host'}, 'host = '),
        ({'settings': Settings(joint_names=('a', 'b'))}, 'joint_names has 2 names'),
        ({'controller': 'motoman', 'settings': Settings(interface='download')}, 'interface'),
    ],
)
def test_invalid_argument_is_rejected_by_its_name(arguments, expected):
    with pytest.raises(ValueError, match=expected):
        Robot(**arguments)


def test_joint_names_are_used_and_at_most_ten_joints_accepted(tmp_path):
    names = tuple('abcdef')
    setup = aio.Robot(settings=Settings(joint_names=names))._setup
    assert setup.model.joint_names == setup.configuration.limits.names == names
    with pytest.raises(ValueError, match='c3_with_11_joints has 11 joints: at most 10'):
        Robot(model=str(arm_file(tmp_path, 11)))


@pytest.mark.parametrize(
    'wrong',
    [{'reply_timeout': 0}, {'goal_tolerance': float('nan')}, {'byte_order': 'middle'}],
)
def test_invalid_setting_is_rejected_by_its_name(wrong):
    (name,) = wrong
    with pytest.raises(ValueError, match=f'{name} = '):
        Settings(**wrong)


def test_remedies_do_not_mention_ros():
    words = [WORDS.get(remedy, remedy.value) for remedy in Remedy]
    assert not any('~/' in text or 'robot_ip' in text for text in words)
    for path in Path(driver.__file__).parent.rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text('utf-8'))):
            if not isinstance(node, ast.Expr):  # a docstring
                texts = [getattr(child, 'value', '') for child in ast.iter_child_nodes(node)]
                assert not any('~/' in text for text in texts if isinstance(text, str)), path


def test_password_that_is_too_long_for_real_time_motion_is_refused_by_name(monkeypatch):
    settings = Settings(password_variable='CELL_PASSWORD')
    monkeypatch.setenv('CELL_PASSWORD', 'ä' * 16)
    Robot('127.0.0.1', controller='rtmc', model='c8_c901s', settings=settings)
    monkeypatch.setenv('CELL_PASSWORD', 'ä' * 16 + 'x')
    with pytest.raises(ArgumentError, match='password_variable = CELL_PASSWORD: 33 bytes'):
        Robot('127.0.0.1', controller='rtmc', model='c8_c901s', settings=settings)
    Robot('127.0.0.1', controller='remote', model='c8_c901s', settings=settings)
