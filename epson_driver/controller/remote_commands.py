# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""EPSON's Remote Ethernet commands: one line in, one line out, by one table.

`$Cmd,parameters` is answered with `#Cmd,value` (0 where there is no value) or `!Cmd,error`.
`$Sim,…` exists in the simulation only: what needs a finger, and `$Sim,timing`: how many motion
cycles came late, how many plans of smooth motion came too late, how often its planner failed.
"""

import logging
from collections.abc import Callable

from epson_driver.controller.core import Controller
from epson_driver.controller.errors import ErrorNumber
from epson_driver.controller.states import ESTOP_CONDITIONS, POWERED_CONDITIONS, RefusedError
from epson_driver.remote_errors import RemoteErrorNumber
from epson_driver.simple_message import Mode

_log = logging.getLogger(__name__)

_ROBOTS = ('', '0', '1')
"""How the one robot is named: not at all, as all robots, by its number."""


class _CommandError(Exception):
    """A command that is answered with an error number."""

    def __init__(self, number: RemoteErrorNumber) -> None:
        super().__init__(number)
        self.number = number


class RemoteSession:
    """What one remote client may do: everything, after it has logged in."""

    def __init__(self) -> None:
        self._logged_in = False

    def answer(self, line: str, controller: Controller) -> str:
        """Obey one line without its terminator; return the answer without terminator."""
        name, *parameters = (part.strip() for part in line.lstrip('$').split(','))
        canonical = _CANONICAL.get(name.lower(), name)
        try:
            if not line.startswith('$'):
                raise _CommandError(RemoteErrorNumber.NO_DOLLAR)
            return f'#{canonical},{self._obey(canonical, parameters, controller)}'
        except _CommandError as error:
            return f'!{canonical},{error.number:d}'
        except RefusedError as refusal:
            _log.warning('remote command refused: %s: %s', line, refusal)
            return f'!{canonical},{RemoteErrorNumber.NOT_READY:d}'

    def _obey(self, name: str, parameters: list[str], controller: Controller) -> str:
        if name == 'Login':  # any password: the simulation guards nothing
            self._logged_in = True
            return '0'
        if name not in _COMMANDS or not self._logged_in:
            raise _CommandError(RemoteErrorNumber.BAD_COMMAND)
        value = _COMMANDS[name](controller, parameters)
        self._logged_in = name != 'Logout'
        return value


def _logout(_controller: Controller, parameters: list[str]) -> str:
    _expect(parameters, 0)
    return '0'


def _reset(controller: Controller, parameters: list[str]) -> str:
    _expect(parameters, 0)
    controller.reset()
    return '0'


def _motors_on(controller: Controller, parameters: list[str]) -> str:
    _expect_robot(parameters)
    controller.motors_on()
    return '0'


def _motors_off(controller: Controller, parameters: list[str]) -> str:
    _expect_robot(parameters)
    controller.motors_off()
    return '0'


def _get_motor(controller: Controller, parameters: list[str]) -> str:
    """Answer number of robots, motors on, power high. The simulation knows no low power."""
    _expect_robot(parameters)
    on = int(controller.condition in POWERED_CONDITIONS)
    return f'1,{on},{on}'


def _get_status(controller: Controller, parameters: list[str]) -> str:
    """Answer the flags of the RC700 generation and the error number."""
    _expect(parameters, 0)
    error = controller.error_number
    flags = (
        False,  # Test
        controller.profile.mode is Mode.MANUAL,  # Teach
        controller.profile.mode is Mode.AUTO,  # Auto
        False,  # Warning
        False,  # SError
        False,  # Safeguard
        controller.condition in ESTOP_CONDITIONS,  # EStop
        error is not ErrorNumber.NONE,  # Error
        False,  # Paused
        controller.moving,  # Running
        not controller.moving,  # Ready
    )
    return ''.join(str(int(flag)) for flag in flags) + f',{error:04d}'


def _sim(controller: Controller, parameters: list[str]) -> str:
    action = _SIM.get(','.join(parameters).lower())
    if action is None:
        raise _CommandError(RemoteErrorNumber.PARAMETER)
    return action(controller) or '0'


def _timing(controller: Controller) -> str:
    timing = controller.timing
    return f'{timing.deadline_misses},{timing.late_plans},{timing.planner_failures}'


def _expect(parameters: list[str], count: int) -> None:
    if len(parameters) != count:
        raise _CommandError(RemoteErrorNumber.FORMAT)


def _expect_robot(parameters: list[str]) -> None:
    if len(parameters) > 1:
        raise _CommandError(RemoteErrorNumber.FORMAT)
    if parameters and parameters[0] not in _ROBOTS:
        raise _CommandError(RemoteErrorNumber.PARAMETER)


_COMMANDS: dict[str, Callable[[Controller, list[str]], str]] = {
    'Logout': _logout,
    'Reset': _reset,
    'SetMotorsOn': _motors_on,
    'SetMotorsOff': _motors_off,
    'GetMotor': _get_motor,
    'GetStatus': _get_status,
    'Sim': _sim,
}

_SIM: dict[str, Callable[[Controller], str | None]] = {
    'estop,press': Controller.estop_press,
    'estop,release': Controller.estop_release,
    'timing': _timing,
}

_CANONICAL = {name.lower(): name for name in ('Login', *_COMMANDS)}
