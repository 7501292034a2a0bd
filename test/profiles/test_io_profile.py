# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The I/O section of a controller's profile."""

from typing import Any

import pytest

from epson_driver.inputs import InputError
from epson_driver.profiles.io_profile import IoProfile, read_io_profile
from epson_driver.simple_message import IoType

DO, AO = IoType.DIGITAL_OUTPUT, IoType.ANALOG_OUTPUT


def test_empty_profile_is_an_rc620() -> None:
    assert read_io_profile({}, 'cell.yaml') == IoProfile()


def test_every_key_of_a_profile_is_read() -> None:
    profile = read_io_profile(
        {
            'access': 'motoman',
            'digital_inputs': 8,
            'digital_outputs': 4,
            'analog_inputs': 0,
            'analog_outputs': 1,
            'flags': 0,
            'analog_range': [0, 4.0956],
            'safe': {'DO2': True, 'AO0': 1},
            'keep_on_reset': 'all',
            'keep_on_link_loss': [],
            'publish_period': 0.5,
            'publish_interval': 0.002,
        },
        'cell.yaml',
    )
    assert profile == IoProfile(
        'motoman',
        8,
        4,
        0,
        1,
        0,
        (0.0, 4.0956),
        {(DO, 2): 1, (AO, 0): 1000},
        frozenset({(DO, 0), (DO, 1), (DO, 2), (DO, 3), (AO, 0)}),
        frozenset(),
        0.5,
        0.002,
    )
    assert profile.analog_limits == (0, 4095)


NUMBER = 'must be a whole number from 0 to 4096'


@pytest.mark.parametrize(
    ('data', 'text'),
    [
        ({'outputs': 3}, 'io.outputs is not a key of the section io'),
        ({3: 3}, 'io.3 is not a key of the section io'),
        ({'flags': -1}, f'io.flags = -1: {NUMBER}'),
        ({'flags': 4097}, f'io.flags = 4097: {NUMBER}'),
        ({'flags': True}, f'io.flags = True: {NUMBER}'),
        ({'digital_inputs': 2.0}, f'io.digital_inputs = 2.0: {NUMBER}'),
        ({'publish_period': 0}, 'io.publish_period = 0: must be a number from 0.001 to 60'),
        (
            {'publish_interval': float('nan')},
            'io.publish_interval = nan: must be a number from 0.001 to 60',
        ),
        ({'analog_range': 10}, 'io.analog_range = 10: must be two numbers, in V'),
        (
            {'analog_range': [-5, 'x']},
            "io.analog_range[1] = 'x': must be a number from -100 to 100",
        ),
        ({'analog_range': [1, 5]}, 'io.analog_range = [1, 5]: must include 0 V'),
        ({'analog_range': [5, -5]}, 'io.analog_range = [5, -5]: must include 0 V'),
        (
            {'safe': ['DO3']},
            "io.safe = ['DO3']: must be a mapping, such as {DO3: 1, AO0: 2.5}",
        ),
        ({'safe': {'DO3': 2}}, 'io.safe.DO3 = 2: must be 0 or 1'),
        ({'safe': {'AO0': 11}}, 'io.safe.AO0 = 11: must be a number from -10 to 10'),
        (
            {'safe': {'DI0': 1}},
            "io.safe: 'DI0' must be an output: DO0 to DO15 or AO0 to AO1",
        ),
        (
            {'keep_on_reset': ['DO16']},
            "io.keep_on_reset: 'DO16' must be an output: DO0 to DO15 or AO0 to AO1",
        ),
        (
            {'keep_on_link_loss': 'some'},
            "io.keep_on_link_loss = 'some': must be a list of outputs, or all",
        ),
        (
            {'keep_on_link_loss': [['DO1']], 'analog_outputs': 0},
            "io.keep_on_link_loss: ['DO1'] must be an output: DO0 to DO15",
        ),
    ],
)
def test_profile_error_names_file_key_and_value(data: dict[Any, Any], text: str) -> None:
    with pytest.raises(InputError) as error:
        read_io_profile(data, 'cell.yaml')
    assert str(error.value) == f'cell.yaml: {text}'
