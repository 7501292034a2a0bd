# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`$Sim,…` commands: operator actions, faults, and data of the simulation.

In an answer, `;` separates the parts, and `=` separates the name and the value of a part.
"""

from collections.abc import Callable
from typing import NamedTuple

from epson_driver.remote_ethernet.client import RemoteErrorNumber
from epson_driver.sim_controller.condition.states import REGIONS, Event
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.faults.fault_kinds import FaultError, parse
from epson_driver.sim_controller.io.io_points import IoError
from epson_driver.sim_controller.remote.remote_acceptance import (
    AUTO,
    PAUSED,
    CommandError,
    check,
    expect,
    parameter_error,
    real,
    whole,
)
from epson_driver.simple_message import IoType

IO_KINDS = {
    'DI': IoType.DIGITAL_INPUT,
    'DO': IoType.DIGITAL_OUTPUT,
    'AI': IoType.ANALOG_INPUT,
    'AO': IoType.ANALOG_OUTPUT,
    'flag': IoType.FLAG,
}
"""Name in commands → I/O type.

Analogue points are in mV. `flag` is a memory bit.
"""

_INPUTS = (IoType.DIGITAL_INPUT, IoType.ANALOG_INPUT)
_ANALOG = (IoType.ANALOG_INPUT, IoType.ANALOG_OUTPUT)

_MAX_INDEX = 65_535
_MAX_VALUE = 2**31 - 1
_MAX_PUSH = 360.0  # degrees, or mm


class SimCommand(NamedTuple):
    usage: str
    text: str
    run: Callable[[Controller, list[str]], str | None]


def simulate(controller: Controller, parameters: list[str]) -> str | None:
    name = parameters[0].lower() if parameters else ''
    if name not in SIM_COMMANDS:
        raise parameter_error(
            '$Sim', name, f'must be one of {", ".join(SIM_COMMANDS)}, print, why'
        )
    return SIM_COMMANDS[name].run(controller, parameters[1:])


def _events(**events: Event) -> Callable[[Controller, list[str]], None]:
    def run(controller: Controller, parameters: list[str]) -> None:
        event = events.get(','.join(parameters).lower())
        if event is None:
            raise parameter_error('word', ','.join(parameters), f'must be {" or ".join(events)}')
        controller.apply(event)

    return run


def _continue(controller: Controller, parameters: list[str]) -> None:
    expect(parameters, 0)
    check(controller, (AUTO, PAUSED), Event.CONTINUE)
    controller.apply(Event.CONTINUE)


def _condition(controller: Controller, parameters: list[str]) -> str:
    expect(parameters, 0)
    return ';'.join(f'{name}={getattr(controller.condition, name).value}' for name in REGIONS)


def _identity(controller: Controller, parameters: list[str]) -> str:
    expect(parameters, 0)
    return f'controller={controller.profile.name};robot={controller.model.name}'


def _joints(controller: Controller, parameters: list[str]) -> str:
    expect(parameters, 0)
    return ' '.join(
        f'{value:.5f}' for value in controller.arm.commanded * controller.model.shown_per_unit
    )


def _io(controller: Controller, parameters: list[str]) -> str | None:
    expect(parameters, 0, 3)
    if not parameters:
        return ';'.join(_points(controller, name) for name in IO_KINDS)
    expect(parameters, 2, 3)
    kinds = {name.lower(): io_type for name, io_type in IO_KINDS.items()}
    io_type = kinds.get(parameters[0].lower())
    if io_type is None:
        raise parameter_error('points', parameters[0], f'must be one of {", ".join(IO_KINDS)}')
    index = whole('index', parameters[1], 0, _MAX_INDEX)
    try:
        if len(parameters) < 3:
            return str(controller.io.read(io_type, index))
        value = whole('value', parameters[2], -_MAX_VALUE, _MAX_VALUE)
        change = controller.io.set_input if io_type in _INPUTS else controller.io.write
        change(io_type, index, value)
    except IoError as error:
        raise CommandError(RemoteErrorNumber.PARAMETER, str(error)) from error
    return None


def _points(controller: Controller, name: str) -> str:
    """Return `name=count:` and the indices of the points that are on.

    For analogue points, return all values instead.
    """
    io_type = IO_KINDS[name]
    values: list[int] = []
    for result in controller.io.ranges():
        if result.io_type == io_type:
            values += controller.io.read_range(io_type, result.start, result.count)
    shown = (
        values if io_type in _ANALOG else [index for index, value in enumerate(values) if value]
    )
    return f'{name}={len(values)}:{" ".join(map(str, shown))}'


def _disturb(controller: Controller, parameters: list[str]) -> None:
    expect(parameters, 2)
    joint = whole('joint', parameters[0], 1, len(controller.model.joint_names))
    push = real('degrees', parameters[1], -_MAX_PUSH, _MAX_PUSH)
    controller.disturb(joint - 1, push / float(controller.model.shown_per_unit[joint - 1]))


def _fault(controller: Controller, parameters: list[str]) -> str | None:
    faults = controller.faults
    first = parameters[0].lower() if parameters else 'list'
    try:
        if first == 'list':
            expect(parameters, 0, 1)
            return ';'.join(faults.active())
        if first == 'clear':
            expect(parameters, 1, 2)
            return str(faults.clear(*(name.lower() for name in parameters[1:])))
        faults.start(parse(','.join(parameters)))
    except FaultError as error:
        raise CommandError(RemoteErrorNumber.PARAMETER, str(error)) from error
    return None


def _reboot(controller: Controller, parameters: list[str]) -> None:
    expect(parameters, 0, 1)
    _fault(controller, ['reboot', *(f'for={seconds}' for seconds in parameters)])


def _tasks(controller: Controller, parameters: list[str]) -> str:
    expect(parameters, 0)
    return ';'.join(
        f'{row.number}={row.name},{row.type},{row.state}' for row in controller.tasks()
    )


def _timing(controller: Controller, parameters: list[str]) -> str:
    expect(parameters, 0)
    timing = controller.timing
    return (
        f'{timing.deadline_misses},{timing.late_plans},{timing.planner_failures},'
        f'{timing.violations}'
    )


SIM_COMMANDS: dict[str, SimCommand] = {
    'estop': SimCommand(
        'estop,press|release',
        'the E-stop button',
        _events(press=Event.ESTOP_PRESS, release=Event.ESTOP_RELEASE),
    ),
    'door': SimCommand(
        'door,open|close',
        'the safeguard door',
        _events(open=Event.DOOR_OPEN, close=Event.DOOR_CLOSE),
    ),
    'continue': SimCommand(
        'continue', 'like the command Continue, by an operator at the controller', _continue
    ),
    'mode': SimCommand(
        'mode,auto|manual',
        'the key switch',
        _events(auto=Event.MODE_AUTO, manual=Event.MODE_MANUAL),
    ),
    'power': SimCommand(
        'power,high|low',
        'set the power, as the statement Power does',
        _events(high=Event.POWER_HIGH, low=Event.POWER_LOW),
    ),
    'io': SimCommand(
        'io[,DI|DO|AI|AO|flag,index[,value]]',
        'set or read a point (inputs too), or list the numbers of points and those that are on '
        '(analogue points: their values, mV)',
        _io,
    ),
    'disturb': SimCommand('disturb,joint,degrees', 'push a joint', _disturb),
    'fault': SimCommand(
        'fault[,name,key=value,…|,list|,clear[,name]]',
        'start a fault, list the active ones, clear one or all (replies their number)',
        _fault,
    ),
    'reboot': SimCommand('reboot[,seconds]', 'the fault `reboot`: a power cycle', _reboot),
    'identity': SimCommand('identity', 'profile and robot model', _identity),
    'condition': SimCommand('condition', 'condition of the controller by region', _condition),
    'joints': SimCommand('joints', 'commanded joint positions, degrees or mm', _joints),
    'tasks': SimCommand('tasks', 'number=name,type,state of each task', _tasks),
    'timing': SimCommand(
        'timing',
        'late motion cycles, late plans, planner failures, prevented limit violations',
        _timing,
    ),
}
"""Name → command. remote_commands.py adds `$Sim,why` and `$Sim,print`, which need the session."""
