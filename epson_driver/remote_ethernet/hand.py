# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Operator actions at a controller: a command table for `pendant`, panel and Python API.

`$Sim,…` commands work only with the simulated controller. At a real controller, an operator
performs these actions by hand.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from epson_driver.inputs import meant
from epson_driver.remote_ethernet.client import Ask, RemoteError, RemoteErrorNumber

MAX_ECHO_CHARACTERS = 200  # maximum length of an invalid input in an error text


class UsageError(ValueError):
    """The text of an action is invalid. The message lists the valid forms."""


class RefusedError(Exception):
    """The controller refused an action. `number` is NOT_READY if the reason is unknown, else 0."""

    def __init__(self, text: str, number: int = 0) -> None:
        super().__init__(text)
        self.number = number


class Action(NamedTuple):
    """An operator action.

    `stops`: whether the action can only stop the arm, so that it may be repeated.
    """

    commands: tuple[str, ...]  # alternatives, tried until the controller supports one
    done: str = ''  # text after success; empty: the controller's reply
    moves: bool = False  # the arm may move
    stops: bool = False


ACTIONS = {
    'motors on': Action(('SetMotorsOn,1',), 'motors on', moves=True),
    'motors off': Action(('SetMotorsOff,1',), 'motors off', stops=True),
    'power high': Action(('Sim,power,high', 'Execute,"Power High"'), 'power high'),
    'power low': Action(
        ('Sim,power,low', 'Execute,"Power Low"'), 'low power forced until `power high`'
    ),
    'estop press': Action(('Sim,estop,press',), 'E-stop pressed', stops=True),
    'estop release': Action(('Sim,estop,release',), 'E-stop released (latched until `reset`)'),
    'door open': Action(('Sim,door,open',), 'door open', stops=True),
    'door close': Action(
        ('Sim,door,close',), 'door closed (interrupted tasks wait for `continue`)'
    ),
    'mode auto': Action(('Sim,mode,auto',), 'key switch at AUTO'),
    'mode manual': Action(('Sim,mode,manual',), 'key switch at MANUAL, motors off'),
    'pause': Action(('Pause',), 'all tasks paused (resume with `continue`)', stops=True),
    'continue': Action(('Sim,continue', 'Continue'), 'tasks resumed', moves=True),
    'stop': Action(('Stop',), 'all tasks stopped (restart with `start`)', stops=True),
    'start': Action(('Start,0',), 'main started', moves=True),
    'reset': Action(('Reset',), 'reset done (switch the motors on separately)'),
    'io': Action(('Sim,io',)),
    'fault': Action(('Sim,fault,list',)),
}

FORMS = {  # form of an action with arguments → its description
    'io KIND INDEX': 'read an I/O point, KIND = DI, DO or flag (*: AI or AO, too)',
    'io KIND INDEX VALUE': 'set DO or flag to on or off (*: DI, too, and AI or AO in mV)',
    'fault NAME [KEY=VALUE …]': 'start a fault',
    'fault clear [NAME]': 'clear one fault, or all',
    'disturb JOINT DEGREES': 'push a joint (mm if it is linear)',
    'reboot [SECONDS]': 'power cycle, off for SECONDS (default: 5)',
}

POINTS = {
    'DI': ('GetIO,{}', ''),
    'DO': ('Execute,"Print Oport({})"', 'SetIO,{},{}'),
    'flag': ('GetMemIO,{}', 'SetMemIO,{},{}'),
}
"""Kind of I/O → commands that read and write a point of a real controller ('': unsupported)."""

SWITCH = {'off': '0', 'on': '1'}


def overview(more: Mapping[str, str]) -> str:
    """Return a line for each action, and for those of `more`. * marks the simulated ones."""
    rows = [(' ', *row) for row in more.items()]
    rows += [(' ' if form.startswith('io ') else '*', form, text) for form, text in FORMS.items()]
    for words, item in ACTIONS.items():
        simulated = all(command.startswith('Sim,') for command in item.commands)
        rows.append(('*' if simulated else ' ', words, item.done or 'list all'))
    return '\n'.join(f'  {words:26}{mark} {text}' for mark, words, text in rows)


def action(text: str) -> Action:
    words = text.split()
    message = ' '.join(words)
    if message in ACTIONS:
        return ACTIONS[message]
    first, *rest = words or ['']
    if first not in {form.partition(' ')[0] for form in FORMS} or not text.isprintable():
        message = message[:MAX_ECHO_CHARACTERS]
        raise UsageError(f'{message!r}: {meant(message, [*ACTIONS, *FORMS])}')
    if first == 'io':
        return _point(rest)
    return Action((','.join(('Sim', *words)),), f'{message}: done')


def _point(words: Sequence[str]) -> Action:
    kind, index, value = (*words, '', '', '')[:3]
    number = SWITCH.get(value, value)
    if len(words) not in (2, 3) or not index.isdecimal() or (number and not _is_number(number)):
        message = ' '.join(words)[:MAX_ECHO_CHARACTERS]
        raise UsageError(
            f'io {message}: must be io KIND INDEX [VALUE], VALUE = on, off or a number'
        )
    commands = [','.join(filter(None, ('Sim', 'io', kind, index, number)))]
    if real := POINTS.get(kind, ('', ''))[bool(number)]:
        commands.append(real.format(index, number))
    return Action(tuple(commands), f'{kind} {index}: {value}' if number else '')


def _is_number(text: str) -> bool:
    return text.removeprefix('-').isdecimal() and text.isascii()


async def do(ask: Ask, requested: Action) -> str:
    for command in requested.commands:
        try:
            return await ask(command)
        except RemoteError as error:
            if error.number == RemoteErrorNumber.BAD_COMMAND and command.startswith('Sim,'):
                continue
            why = await value_or_empty(ask, 'Sim,why')
            unknown = not why and error.number == RemoteErrorNumber.NOT_READY
            raise RefusedError(why or str(error), error.number if unknown else 0) from error
    raise RefusedError('not possible remotely at a real controller: do it there by hand')


async def value_or_empty(ask: Ask, command: str) -> str:
    try:
        return await ask(command)
    except RemoteError:
        return ''
