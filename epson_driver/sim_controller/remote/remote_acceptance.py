# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""When the controller accepts a remote command, and why it does not.

The conditions are those of the RC+ user's guide, Remote Ethernet, "input acceptance condition".
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

from epson_driver.remote_ethernet.errors import RemoteErrorNumber
from epson_driver.sim_controller.condition.states import EStop, Event, RejectedError, Tasks, after
from epson_driver.sim_controller.remote.controller_interface import ControllerInterface
from epson_driver.sim_controller.remote.status_words import FLAGS, Predicate


class CommandError(Exception):
    """A command that is answered with an error number, with the reason as its text."""

    def __init__(self, number: RemoteErrorNumber, sentence: str) -> None:
        super().__init__(sentence)
        self.number = number


class Requirement(NamedTuple):
    """A condition for a command, with a sentence for when it does not hold."""

    text: str
    holds: Predicate
    sentence: Callable[[ControllerInterface], str]


def _is(flag: str, sentence: Callable[[ControllerInterface], str]) -> Requirement:
    return Requirement(flag, FLAGS[flag], sentence)


def _no(flag: str, sentence: Callable[[ControllerInterface], str]) -> Requirement:
    return Requirement(f'no {flag}', lambda controller: not FLAGS[flag](controller), sentence)


def _not_ready(controller: ControllerInterface) -> str:
    if controller.program_runs:
        return 'the program runs: stop first'
    if not controller.condition.paused:
        return 'the arm still moves: try again when it stands'
    first = 'close the door and ' if FLAGS['Safeguard'](controller) else ''
    return f'the tasks are paused: {first}continue, or stop, first'


def _not_paused(controller: ControllerInterface) -> str:
    tasks = controller.condition.tasks
    return 'nothing is paused' if tasks is Tasks.RUNNING else f'the tasks are {tasks.value}'


def _in_error(controller: ControllerInterface) -> str:
    number = controller.error_number
    way = 'boot the controller again' if FLAGS['SError'](controller) else 'reset first'
    return f'there is error {number:04d} ({controller.error_text(number)}): {way}'


def _estopped(controller: ControllerInterface) -> str:
    if controller.condition.estop is EStop.PRESSED:
        return 'the E-stop is pressed: release the E-stop, then reset'
    return 'the E-stop is released but not reset: reset'


def _tasks_run(controller: ControllerInterface) -> bool:
    return controller.condition.tasks in (Tasks.RUNNING, Tasks.RECOVERING)


def _no_tasks(controller: ControllerInterface) -> str:
    return f'the tasks are {controller.condition.tasks.value}: there is nothing to pause'


AUTO = _is('Auto', lambda _: 'the key switch is at MANUAL: turn it to AUTO first')
READY = _is('Ready', _not_ready)
NO_PROGRAM = Requirement(
    'no SPEL+ program', lambda controller: not controller.program_runs, _not_ready
)
PAUSED = _is('Paused', _not_paused)
NO_ESTOP = _no('EStop', _estopped)
NO_SAFEGUARD = _no('Safeguard', lambda _: 'the safeguard door is open: close it first')
NO_ERROR = _no('Error', _in_error)
TASKS_RUN = Requirement('tasks run', _tasks_run, _no_tasks)


def check(
    controller: ControllerInterface, requirements: Iterable[Requirement], event: Event | None
) -> None:
    """Raise RejectedError if the controller does not accept a command that does `event` now."""
    for requirement in requirements:
        if not requirement.holds(controller):
            raise RejectedError(requirement.sentence(controller))
    if event is not None:
        after(controller.condition, event)
