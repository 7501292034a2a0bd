# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ functions that can be printed, as a table: state, settings, I/O of a controller.

`print_list(controller, 'CtrlInfo(1), Agl(2)')` returns the values with a space between them, as
SPEL+'s Print does. Truth is -1, as in SPEL+.
"""

import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from epson_driver.remote_ethernet.errors import RemoteErrorNumber
from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.sim_controller.condition.spel_settings import SETTINGS
from epson_driver.sim_controller.condition.tasks import PROGRAM, TaskState
from epson_driver.sim_controller.io.io_points import BYTE_BITS, WORD_BITS, IoError
from epson_driver.sim_controller.remote import spel_numbers, status_words
from epson_driver.sim_controller.remote.controller_interface import ControllerInterface
from epson_driver.sim_controller.remote.remote_acceptance import CommandError
from epson_driver.sim_controller.remote.remote_parameters import expect, whole, wrong
from epson_driver.simple_message import IoType

_REMOTE_ETHERNET = 26
"""CtrlInfo(5): the control device."""

_MAX_TASK = 267
_MAX_ADDRESS = 65_535

_ITEM = re.compile(r'\s*([A-Za-z]+\$?)\s*(?:\(([^()]*)\))?\s*(?:,|$)')


class Function(NamedTuple):
    """How many arguments, what it is, and its value as Print shows it."""

    least: int
    most: int
    text: str
    value: Callable[[ControllerInterface, Sequence[str]], str]


def print_list(controller: ControllerInterface, text: str) -> str:
    """Return the values of a list of functions. Raises CommandError."""
    shown: list[str] = []
    at = 0
    while at < len(text) or not shown:
        item = _ITEM.match(text, at)
        if item is None or text.rstrip().endswith(','):
            rule = 'must be functions with whole numbers as arguments and commas between'
            raise CommandError(RemoteErrorNumber.FORMAT, f'Print {text}: {rule}')
        shown.append(_value(controller, item[1], item[2]))
        at = item.end()
    return ' '.join(shown)


def _value(controller: ControllerInterface, name: str, within: str | None) -> str:
    canonical = _CANONICAL.get(name.lower())
    if canonical is None:
        raise wrong('function', name, f'must be one of {", ".join(FUNCTIONS)}')
    function = FUNCTIONS[canonical]
    arguments = [part.strip() for part in within.split(',')] if within else []
    expect(arguments, function.least, function.most)
    return function.value(controller, arguments)


def _word(tables: dict[str, Callable[[ControllerInterface], int]]) -> Callable[..., str]:
    def value(controller: ControllerInterface, arguments: Sequence[str]) -> str:
        if arguments[0] not in tables:
            raise wrong('number', arguments[0], f'must be one of {", ".join(tables)}')
        return str(tables[arguments[0]](controller))

    return value


def _of(table: dict[int, status_words.Predicate]) -> Callable[[ControllerInterface], int]:
    return partial(status_words.word, table)


def _truth(predicate: status_words.Predicate) -> Callable[..., str]:
    return lambda controller, _arguments: '-1' if predicate(controller) else '0'


def _one(predicate: status_words.Predicate) -> Callable[..., str]:
    return lambda controller, _arguments: str(int(predicate(controller)))


def _task_state(controller: ControllerInterface, arguments: Sequence[str]) -> str:
    number = whole('task', arguments[0], 1, _MAX_TASK)
    states = {task.number: controller.task_state(task) for task in PROGRAM}
    return str(states.get(number, TaskState.NOT_RUNNING).value)


def _task_info(controller: ControllerInterface, arguments: Sequence[str]) -> str:
    types = {task.number: task.type for task in PROGRAM}
    number = whole('task', arguments[0], 1, max(types))
    whole('number', arguments[1], 2, 2)
    return str(types[number].value)


def _err(controller: ControllerInterface, arguments: Sequence[str]) -> str:
    if not arguments:
        return str(int(controller.error_number))
    aborted = _task_state(controller, arguments) == str(TaskState.ABORTED.value)
    return str(int(ErrorNumber.TASK_ABORTED)) if aborted else '0'


def _err_msg(controller: ControllerInterface, arguments: Sequence[str]) -> str:
    return controller.error_text(whole('error', arguments[0], 0, 9999))


def _degrees(controller: ControllerInterface, arguments: Sequence[str]) -> str:
    joint = _joint(controller, arguments)
    return f'{_shown(controller, joint):.3f}'


def _pulses(controller: ControllerInterface, arguments: Sequence[str]) -> str:
    joint = _joint(controller, arguments)
    return str(round(_shown(controller, joint) * controller.model.pulses_per_degree[joint]))


def _shown(controller: ControllerInterface, joint: int) -> float:
    """Return where a joint is, in degrees, or mm."""
    position = controller.joint_position().joints[joint]
    return float(position * controller.model.shown_per_unit[joint])


def _joint(controller: ControllerInterface, arguments: Sequence[str]) -> int:
    return whole('joint', arguments[0], 1, len(controller.model.joint_names)) - 1


def _setting(name: str, controller: ControllerInterface, arguments: Sequence[str]) -> str:
    return spel_numbers.show(controller, name, arguments)


def _bits(io_type: IoType, width: int) -> Callable[..., str]:
    def value(controller: ControllerInterface, arguments: Sequence[str]) -> str:
        index = whole('address', arguments[0], 0, _MAX_ADDRESS)
        try:
            return str(controller.io.read_port(io_type, index, width))
        except IoError as error:
            raise CommandError(RemoteErrorNumber.PARAMETER, str(error)) from error

    return value


FUNCTIONS: dict[str, Function] = {
    'CtrlInfo': Function(
        1,
        1,
        '1 state, 5 control device, 6 robots, 7 mode',
        _word(
            {
                '1': _of(status_words.CTRL_INFO_1),
                '5': lambda _: _REMOTE_ETHERNET,
                '6': lambda _: 1,
                '7': _of(status_words.CTRL_INFO_7),
            }
        ),
    ),
    'RobotInfo': Function(1, 1, '0 state', _word({'0': _of(status_words.ROBOT_INFO_0)})),
    'Stat': Function(
        1,
        1,
        '0 controller, 1 robot',
        _word({'0': _of(status_words.STAT_0), '1': _of(status_words.STAT_1)}),
    ),
    'TaskState': Function(1, 1, 'what a task is doing', _task_state),
    'TaskInfo': Function(2, 2, '2 type of a task', _task_info),
    'Err': Function(0, 1, 'error number; with a task, why that one was aborted', _err),
    'ErrMsg$': Function(1, 1, 'text of an error number', _err_msg),
    'ErrorOn': Function(0, 0, 'in error', _truth(status_words.FLAGS['Error'])),
    'EStopOn': Function(0, 0, 'E-stop active', _truth(status_words.FLAGS['EStop'])),
    'SafetyOn': Function(0, 0, 'door open', _truth(status_words.door_open)),
    'PauseOn': Function(0, 0, 'tasks paused', _truth(status_words.FLAGS['Paused'])),
    'Motor': Function(0, 0, 'motors on', _one(status_words.motors_on)),
    'Power': Function(0, 0, 'power high', _one(status_words.power_high)),
    'Robot': Function(0, 0, 'number of the robot', lambda _controller, _arguments: '1'),
    'Agl': Function(1, 1, 'position of a joint, degrees (or mm)', _degrees),
    'Pls': Function(1, 1, 'encoder of a joint, pulses', _pulses),
    **{
        name: Function(0, 1, f'what is set, {setting.unit}', partial(_setting, name))
        for name, setting in SETTINGS.items()
    },
    'Sw': Function(1, 1, 'input bit', _bits(IoType.DIGITAL_INPUT, 1)),
    'In': Function(1, 1, 'input port, 8 bits', _bits(IoType.DIGITAL_INPUT, BYTE_BITS)),
    'InW': Function(1, 1, 'input word, 16 bits', _bits(IoType.DIGITAL_INPUT, WORD_BITS)),
    'Oport': Function(1, 1, 'output bit', _bits(IoType.DIGITAL_OUTPUT, 1)),
    'Out': Function(1, 1, 'output port, 8 bits', _bits(IoType.DIGITAL_OUTPUT, BYTE_BITS)),
    'OutW': Function(1, 1, 'output word, 16 bits', _bits(IoType.DIGITAL_OUTPUT, WORD_BITS)),
    'MemSw': Function(1, 1, 'memory bit', _bits(IoType.FLAG, 1)),
    'MemIn': Function(1, 1, 'memory port, 8 bits', _bits(IoType.FLAG, BYTE_BITS)),
    'MemInW': Function(1, 1, 'memory word, 16 bits', _bits(IoType.FLAG, WORD_BITS)),
}
"""What can be printed."""

_CANONICAL = {name.lower(): name for name in FUNCTIONS}
