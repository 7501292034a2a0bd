# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The words of `pendant` as tables, and the remote commands that they stand for."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from epson_driver.processes.executables import EXECUTABLES
from epson_driver.sim_controller.faults.fault_kinds import FAULTS

MAX_ECHO_CHARACTERS = 200
"""Error texts repeat no more characters of the words given."""


class UsageError(ValueError):
    """Words that have no meaning, with those allowed in its text."""


class Request(NamedTuple):
    """Equivalent remote commands, of which the first that the controller knows is used.

    `done` is the text to print afterwards, or a function that makes it from the answer's value.
    `repeatable`: it only stops, so it is given again where a controller that hung up may have done
    it or not.
    """

    commands: tuple[str, ...]
    done: str | Callable[[str], str]
    repeatable: bool = False


class Form(NamedTuple):
    """A first word that takes arguments: its usages, what each does, and the request for them."""

    usages: Mapping[str, str]
    request: Callable[[Sequence[str]], Request]


ACTIONS: dict[str, Request] = {
    'motors on': Request(('SetMotorsOn,1',), 'motors on'),
    'motors off': Request(('SetMotorsOff,1',), 'motors off', repeatable=True),
    'power high': Request(('Sim,power,high', 'Execute,"Power High"'), 'power high'),
    'power low': Request(
        ('Sim,power,low', 'Execute,"Power Low"'), 'power low, until it is said to be high'
    ),
    'estop press': Request(('Sim,estop,press',), 'E-stop pressed', repeatable=True),
    'estop release': Request(
        ('Sim,estop,release',), 'E-stop released; it stays latched until the reset'
    ),
    'door open': Request(('Sim,door,open',), 'door open', repeatable=True),
    'door close': Request(
        ('Sim,door,close',), 'door closed; what it interrupted waits for continue'
    ),
    'mode auto': Request(('Sim,mode,auto',), 'key switch at AUTO'),
    'mode manual': Request(('Sim,mode,manual',), 'key switch at MANUAL; the motors go off'),
    'pause': Request(('Pause',), 'paused; continue goes on', repeatable=True),
    'continue': Request(('Continue',), 'the tasks go on'),
    'stop': Request(('Stop',), 'the tasks are stopped; start runs them again', repeatable=True),
    'start': Request(('Start,0',), 'the tasks run'),
    'reset': Request(('Reset',), 'reset; the motors are switched on separately'),
}
"""Actions without arguments, and their remote commands; Sim… is for the simulation only."""

KINDS = {
    'in': ('DI', 'GetIO,{}', ''),
    'out': ('DO', 'Execute,"Print Oport({})"', 'SetIO,{},{}'),
    'ain': ('AI', '', ''),
    'aout': ('AO', '', ''),
    'flag': ('flag', 'GetMemIO,{}', 'SetMemIO,{},{}'),
}
"""The name of a kind of I/O point here and in the simulation, and how real controllers read and
write it."""

SWITCH = {'off': '0', 'on': '1', '0': '0', '1': '1'}

ANALOG = ('ain', 'aout')


def request(words: Sequence[str]) -> Request:
    """Return the request that the words stand for. Raises UsageError."""
    said = ' '.join(words)
    if said in ACTIONS:
        return ACTIONS[said]
    form = FORMS.get(words[0]) if words else None
    if form is None:
        raise UsageError(f'{said[:MAX_ECHO_CHARACTERS]}: must be one of {", ".join(TEXTS)}')
    if not said.isprintable():
        raise UsageError(f'{said[:MAX_ECHO_CHARACTERS]!r}: must be printable')
    try:
        return form.request(words[1:])
    except ValueError as error:
        text = f'{error}: ' if isinstance(error, UsageError) else ''
        raise UsageError(
            f'{said[:MAX_ECHO_CHARACTERS]}: {text}must be {" or ".join(form.usages)}'
        ) from error


def points(value: str) -> str:
    """Return the list of all I/O points as text."""
    names = {sim: (word, word in ANALOG) for word, (sim, _, _) in KINDS.items()}
    lines = []
    for part in value.split(';'):
        sim, _, found = part.partition('=')
        word, analog = names[sim]
        count, _, held = found.partition(':')
        if analog:
            text = ', '.join(f'{volts} mV' for volts in held.split()) or 'none'
        else:
            text = f'{count}, on: {held or "none"}'
        lines.append(f'{word + ":":6}{text}')
    return '\n'.join(lines)


def _io(words: Sequence[str]) -> Request:
    if not words:
        return Request(('Sim,io',), points)
    kind, index, *value = words
    if kind not in KINDS or not _is_index(index) or len(value) > 1:
        raise ValueError
    sim, read, write = KINDS[kind]
    unit = ' mV' if kind in ANALOG else ''
    if not value:
        commands = (f'Sim,io,{sim},{index}', read.format(index))
        return Request(_given(commands), lambda held: f'{kind} {index}: {_shown(kind, held)}')
    number = str(int(value[0])) if kind in ANALOG else SWITCH.get(value[0])
    if number is None:
        raise ValueError
    commands = (f'Sim,io,{sim},{index},{number}', write.format(index, number))
    return Request(_given(commands), f'{kind} {index}: {value[0]}{unit}')


def _is_index(text: str) -> bool:
    return text.isascii() and text.isdecimal()


def _given(commands: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(command for command in commands if command)


def _shown(kind: str, held: str) -> str:
    held = held.strip('" ')
    return f'{held} mV' if kind in ANALOG else {'0': 'off', '1': 'on'}.get(held, held)


def _fault(words: Sequence[str]) -> Request:
    if not words:
        return Request(('Sim,fault,list',), faults)
    if words[0] == 'clear' and len(words) <= 2:
        return Request((','.join(['Sim,fault', *words]),), lambda count: f'{count} cleared')
    if words[0] == 'clear':
        raise ValueError
    return Request((','.join(['Sim,fault', *words]),), f'fault: {" ".join(words)}')


def faults(value: str) -> str:
    """Return the list of active faults as text."""
    return '\n'.join(value.split(';')) if value else 'no faults'


def _disturb(words: Sequence[str]) -> Request:
    joint, degrees = words
    if not _is_index(joint) or not math.isfinite(float(degrees)):
        raise ValueError
    done = f'joint {joint} pushed by {degrees}° (with the motors on, over 1° is a servo error)'
    return Request((f'Sim,disturb,{joint},{degrees}',), done)


def _reboot(words: Sequence[str]) -> Request:
    if len(words) > 1 or not all(math.isfinite(float(word)) for word in words):
        raise ValueError
    return Request((','.join(['Sim,reboot', *words]),), 'it boots; the motors are off then')


FORMS: dict[str, Form] = {
    'io': Form(
        {
            'io': 'list all I/O points',
            'io KIND INDEX': f'read one point; KIND is {", ".join(KINDS)}',
            'io KIND INDEX VALUE': 'set it (an input: as if wired so): on, off, or mV',
        },
        _io,
    ),
    'fault': Form(
        {
            'fault': 'list the active faults',
            'fault NAME [KEY=VALUE …]': 'start one',
            'fault clear [NAME]': 'clear one, or all',
        },
        _fault,
    ),
    'disturb': Form({'disturb JOINT DEGREES': 'push a joint'}, _disturb),
    'reboot': Form({'reboot [SECONDS]': 'switch off and on again'}, _reboot),
}
"""The actions with arguments, by their first word."""

ALONE = {
    'status': 'the state of the controller',
    'fault kinds': 'list the kinds of faults and their parameters',
    'completion': 'for bash: eval "$(epson_driver pendant completion)"',
}
"""Words that are not a remote command each."""

TEXTS: dict[str, str] = {
    'status': ALONE['status'],
    **{said: action.done for said, action in ACTIONS.items() if isinstance(action.done, str)},
    **{usage: text for form in FORMS.values() for usage, text in form.usages.items()},
    **ALONE,
}
"""Every usage, and what it does."""


def following() -> dict[str, list[str]]:
    """Return which words may follow a word, and under '' which may come first."""
    found: dict[str, list[str]] = {'': ['status', 'completion']}
    for said in ACTIONS:
        first, _, second = said.partition(' ')
        if first not in found['']:
            found[''].append(first)
        if second:
            found.setdefault(first, []).append(second)
    found[''] += FORMS
    found['io'] = list(KINDS)
    found['fault'] = ['kinds', 'clear', *FAULTS]
    found['clear'] = list(FAULTS)
    return found


def completion() -> str:
    """Return a bash function that completes the words, and the line that uses it.

    It completes `epson_driver NAME` as well, and files where it knows no word.
    """
    words = following()
    first = words.pop('')
    cases = ''.join(f' {word}) w="{" ".join(after)}";;' for word, after in words.items())
    return (
        '_pendant() { local w; case "${COMP_WORDS[COMP_CWORD-1]}" in'
        f'{cases} *pendant) w="{" ".join(first)}";; '
        f'*epson_driver) w="{" ".join(EXECUTABLES)}";; *) w="";; esac; '
        'COMPREPLY=($(compgen -W "$w" -- "${COMP_WORDS[COMP_CWORD]}")); }; '
        'complete -o default -F _pendant pendant epson_driver'
    )
