# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ statements for `$Execute`, as a table. None of them moves the arm.

Statements that would are refused: only the motion port moves this arm, where points are checked.
"""

import re
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from epson_driver.remote_ethernet.errors import RemoteErrorNumber
from epson_driver.sim_controller.condition.spel_settings import SETTINGS
from epson_driver.sim_controller.condition.states import Event, RejectedError
from epson_driver.sim_controller.io.io_points import BYTE_BITS, IoError
from epson_driver.sim_controller.remote import spel_numbers
from epson_driver.sim_controller.remote.controller_interface import ControllerInterface
from epson_driver.sim_controller.remote.remote_acceptance import CommandError
from epson_driver.sim_controller.remote.remote_parameters import expect, whole, wrong
from epson_driver.sim_controller.remote.spel_functions import print_list
from epson_driver.sim_controller.remote.status_words import error
from epson_driver.simple_message import IoType

MOTION_STATEMENTS = (
    'Go',
    'Move',
    'Jump',
    'Jump3',
    'Jump3CP',
    'Arc',
    'Arc3',
    'Pass',
    'Pulse',
    'BGo',
    'BMove',
    'TGo',
    'TMove',
    'JTran',
    'PTran',
    'CVMove',
    'Home',
)
"""Statements that move the arm of a real controller."""

NO_MOTION = 'only the motion port moves this arm'

_MAX_ADDRESS = 65_535
_MAX_PULSES = 2**31 - 1
_HALF_PULSE = 0.5
_STATEMENT = re.compile(r'\s*([A-Za-z]+[0-9]*[A-Za-z]*)\s*(.*?)\s*')


class Statement(NamedTuple):
    """How it is written, what it does; `run` takes what follows the name, returns a value."""

    usage: str
    text: str
    run: Callable[[ControllerInterface, str], str | None]


def execute(controller: ControllerInterface, statement: str) -> str | None:
    """Execute one statement; return the value that it prints, if it prints one.

    Raises CommandError, or RejectedError for what the condition does not allow.
    """
    parts = _STATEMENT.fullmatch(statement)
    if parts is None:
        raise CommandError(RemoteErrorNumber.FORMAT, f'{statement!r} is no statement')
    name = parts[1].lower()
    if name in _MOVING:
        raise RejectedError(f'{_MOVING[name]}: {NO_MOTION}')
    if name not in _CANONICAL:
        raise wrong('statement', parts[1], f'must be one of {", ".join(STATEMENTS)}')
    return STATEMENTS[_CANONICAL[name]].run(controller, parts[2])


def _list(text: str) -> list[str]:
    return [part.strip() for part in text.split(',')] if text else []


def _set(name: str, controller: ControllerInterface, text: str) -> None:
    spel_numbers.change(controller, name, _list(text))


def _choice(name: str, events: dict[str, Event]) -> Callable[[ControllerInterface, str], None]:
    def run(controller: ControllerInterface, text: str) -> None:
        event = events.get(text.lower())
        if event is None:
            raise wrong(name, text, f'must be {" or ".join(events)}')
        controller.apply(event)

    return run


def _reset(controller: ControllerInterface, text: str) -> None:
    expect(_list(text), 0)
    controller.apply(Event.RESET)


def _if(controller: ControllerInterface, text: str) -> None:
    if ' '.join(text.lower().split()) != 'error on then reset':
        raise wrong('If', text, 'only "If Error On Then Reset" is known')
    if error(controller):
        controller.apply(Event.RESET)


def _switch(io_type: IoType, value: bool, controller: ControllerInterface, text: str) -> None:
    parameters = _list(text)
    expect(parameters, 1)
    bit = whole('bit', parameters[0], 0, _MAX_ADDRESS)
    try:
        controller.io.write(io_type, bit, int(value))
    except IoError as cause:
        raise CommandError(RemoteErrorNumber.PARAMETER, str(cause)) from cause


def _out(io_type: IoType, controller: ControllerInterface, text: str) -> None:
    parameters = _list(text)
    expect(parameters, 2)
    port = whole('port', parameters[0], 0, _MAX_ADDRESS)
    value = whole('value', parameters[1], 0, 2**BYTE_BITS - 1)
    try:
        controller.io.write_port(io_type, port, BYTE_BITS, value)
    except IoError as cause:
        raise CommandError(RemoteErrorNumber.PARAMETER, str(cause)) from cause


def _home_set(controller: ControllerInterface, text: str) -> None:
    parameters, model = _list(text), controller.model
    expect(parameters, len(model.joint_names))
    pulses = [whole('pulses', each, -_MAX_PULSES, _MAX_PULSES) for each in parameters]
    ends = [
        limit * model.pulses_per_unit
        for limit in (model.limits.position_min, model.limits.position_max)
    ]
    low, high = np.minimum(*ends) - _HALF_PULSE, np.maximum(*ends) + _HALF_PULSE
    for joint, value in enumerate(pulses):
        if not low[joint] <= value <= high[joint]:
            rule = f'must be {np.ceil(low[joint]):.0f} to {np.floor(high[joint]):.0f} pulses'
            raise wrong(f'HomeSet joint {joint + 1}', value, rule)
    controller.spel.home = tuple(pulses)


STATEMENTS: dict[str, Statement] = {
    'Print': Statement('Print function, …', 'answer with values', print_list),
    'Motor': Statement(
        'Motor On|Off',
        'motors on or off',
        _choice('Motor', {'on': Event.MOTORS_ON, 'off': Event.MOTORS_OFF}),
    ),
    'Power': Statement(
        'Power High|Low',
        'power high, or low until it is said to be high',
        _choice('Power', {'high': Event.POWER_HIGH, 'low': Event.POWER_LOW}),
    ),
    'Reset': Statement('Reset', 'reset', _reset),
    'If': Statement('If Error On Then Reset', 'reset if there is an error', _if),
    'On': Statement('On bit', 'output on', partial(_switch, IoType.DIGITAL_OUTPUT, True)),
    'Off': Statement('Off bit', 'output off', partial(_switch, IoType.DIGITAL_OUTPUT, False)),
    'Out': Statement('Out port, value', 'eight outputs', partial(_out, IoType.DIGITAL_OUTPUT)),
    'MemOn': Statement('MemOn bit', 'memory bit on', partial(_switch, IoType.FLAG, True)),
    'MemOff': Statement('MemOff bit', 'memory bit off', partial(_switch, IoType.FLAG, False)),
    'MemOut': Statement('MemOut port, value', 'eight memory bits', partial(_out, IoType.FLAG)),
    'HomeSet': Statement('HomeSet pulses, …', 'define the home position', _home_set),
    **{
        name: Statement(
            f'{name} value' + ', value' * (setting.least - 1),
            f'set {setting.low:g} to {setting.high:g} {setting.unit}',
            partial(_set, name),
        )
        for name, setting in SETTINGS.items()
    },
}
"""What `$Execute` executes."""

_CANONICAL = {name.lower(): name for name in STATEMENTS}
_MOVING = {name.lower(): name for name in MOTION_STATEMENTS}
