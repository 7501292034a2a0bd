# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The conditions for remote commands, and the reasons for refusing them.

The conditions follow the RC+ user's guide, Remote Ethernet, "input acceptance condition".
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from epson_driver.remote_ethernet.client import RemoteErrorNumber
from epson_driver.sim_controller.condition.states import EStop, Event, RejectedError, Tasks, after
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.remote.status_words import FLAGS, Predicate


class CommandError(Exception):
    """A command that is answered with the error `number`. The message gives the reason."""

    def __init__(self, number: RemoteErrorNumber, sentence: str) -> None:
        super().__init__(sentence)
        self.number = number


class Requirement(NamedTuple):
    """A condition for accepting a command.

    `sentence` returns the reason for refusing the command if the condition is not met.
    """

    text: str
    is_met: Predicate
    sentence: Callable[[Controller], str]


def _is(flag: str, sentence: Callable[[Controller], str]) -> Requirement:
    return Requirement(flag, FLAGS[flag], sentence)


def _no(flag: str, sentence: Callable[[Controller], str]) -> Requirement:
    return Requirement(f'no {flag}', lambda controller: not FLAGS[flag](controller), sentence)


def _not_ready(controller: Controller) -> str:
    if controller.program.runs:
        return 'the program runs: stop first'
    if not controller.condition.paused:
        return 'the arm is still moving: try again when it has stopped'
    first = 'close the door and ' if FLAGS['Safeguard'](controller) else ''
    return f'the tasks are paused: {first}continue, or stop, first'


def _not_paused(controller: Controller) -> str:
    tasks = controller.condition.tasks
    return 'nothing is paused' if tasks is Tasks.RUNNING else f'the tasks are {tasks.value}'


def _in_error(controller: Controller) -> str:
    number = controller.error_number
    remedy = 'boot the controller again' if FLAGS['SError'](controller) else 'reset first'
    return f'error {number:04d} ({controller.error_text(number)}): {remedy}'


def _estopped(controller: Controller) -> str:
    if controller.condition.estop is EStop.PRESSED:
        return 'the E-stop is pressed: release the E-stop, then reset'
    return 'the E-stop is released but not reset: reset'


def _tasks_run(controller: Controller) -> bool:
    return controller.condition.tasks in (Tasks.RUNNING, Tasks.RECOVERING)


def _no_tasks(controller: Controller) -> str:
    return f'the tasks are {controller.condition.tasks.value}: nothing to pause'


AUTO = _is('Auto', lambda _: 'the key switch is at MANUAL: turn it to AUTO first')
READY = _is('Ready', _not_ready)
NO_PROGRAM = Requirement(
    'no SPEL+ program', lambda controller: not controller.program.runs, _not_ready
)
PAUSED = _is('Paused', _not_paused)
NO_ESTOP = _no('EStop', _estopped)
NO_SAFEGUARD = _no('Safeguard', lambda _: 'the safeguard door is open: close it first')
NO_ERROR = _no('Error', _in_error)
TASKS_RUN = Requirement('tasks run', _tasks_run, _no_tasks)


def check(
    controller: Controller, requirements: Iterable[Requirement], event: Event | None
) -> None:
    for requirement in requirements:
        if not requirement.is_met(controller):
            raise RejectedError(requirement.sentence(controller))
    if event is not None:
        after(controller.condition, event)


_MAX_CHARACTERS = 20  # in a number


def expect(parameters: Sequence[str], minimum: int, maximum: int | None = None) -> None:
    """Raise CommandError (FORMAT) if the number of parameters is not `minimum` to `maximum`."""
    maximum = minimum if maximum is None else maximum
    if not minimum <= len(parameters) <= maximum:
        count = str(minimum) if minimum == maximum else f'{minimum} to {maximum}'
        text = f'{len(parameters)} parameter(s): must be {count}'
        raise CommandError(RemoteErrorNumber.FORMAT, text)


def parameter_error(name: str, value: object, rule: str) -> CommandError:
    return CommandError(RemoteErrorNumber.PARAMETER, f'{name} {value}: {rule}')


def whole(name: str, text: str, low: int, high: int) -> int:
    digits = text.removeprefix('-')
    if digits.isascii() and digits.isdecimal() and len(text) <= _MAX_CHARACTERS:
        value = int(text)
        if low <= value <= high:
            return value
    raise parameter_error(name, text, f'must be a whole number from {low} to {high}')


def hexadecimal(name: str, text: str, high: int) -> int:
    if text and len(text) <= _MAX_CHARACTERS and not set(text.lower()) - set('0123456789abcdef'):
        value = int(text, 16)
        if value <= high:
            return value
    raise parameter_error(name, text, f'must be a hexadecimal number from 0 to {high:X}')


def real(name: str, text: str, low: float, high: float) -> float:
    try:
        value = float(text) if len(text) <= _MAX_CHARACTERS and '_' not in text else math.nan
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise parameter_error(name, text, f'must be a number from {low:g} to {high:g}')
    return value


def switch(name: str, text: str) -> bool:
    if text not in ('0', '1'):
        raise parameter_error(name, text, 'must be 0 or 1')
    return text == '1'


def robot(parameters: Sequence[str]) -> None:
    """Raise CommandError unless the robot number is 1, 0 (all robots), or omitted."""
    if parameters and parameters[0] not in ('', '0', '1'):
        raise parameter_error('robot', parameters[0], 'must be 1, the only robot')
