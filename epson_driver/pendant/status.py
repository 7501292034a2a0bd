# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`pendant status`: the state of a controller, as far as it reports it."""

from collections.abc import Mapping, Sequence

from epson_driver.pendant.commands import faults
from epson_driver.remote_ethernet.client import Ask, RemoteError
from epson_driver.remote_ethernet.status_flags import ask_flags
from epson_driver.sim_controller.condition.errors import ERRORS
from epson_driver.sim_controller.condition.states import EStop
from epson_driver.simple_message import MAX_JOINTS

_ESTOP = {
    EStop.CLEAR.value: 'not active',
    EStop.PRESSED.value: 'pressed (release, then reset)',
    EStop.LATCHED.value: 'released, not reset (reset)',
}
_STATES = {'Paused': 'paused', 'Running': 'a task runs', 'Ready': 'ready'}
"""Flags of GetStatus, the most telling first; whether the arm moves is in none of them."""

SCARA_JOINTS = 4
"""EPSON's arms of four joints are SCARAs, whose third is prismatic."""

_INDENT = '\n' + ' ' * 8


async def status(ask: Ask, who: str) -> str:
    """Return all that a controller, real or simulated, reports, as rows of text.

    `who`: whose state it is.
    """
    flags, number = await ask_flags(ask)
    regions = await _if_known(ask, 'Sim,condition') or ''
    condition = dict(part.split('=', 1) for part in regions.split(';') if part)
    motor = (await _if_known(ask, 'GetMotor,0') or '').split(',')
    rows = {
        'at': who,
        'motors': condition.get('motors') or _on(motor[1:2], 'on', 'off'),
        'power': condition.get('power') or _on(motor[2:3], 'high', 'low'),
        'E-stop': _estop(flags, condition),
        'door': 'open' if 'Safeguard' in flags else 'closed',
        'mode': condition.get('mode') or _mode(flags),
        'tasks': _tasks(await _if_known(ask, 'Sim,tasks')),
        'state': next((text for flag, text in _STATES.items() if flag in flags), 'not ready'),
        'joints': await _joints(ask),
        'error': await _error(ask, number),
        'faults': _faults(await _if_known(ask, 'Sim,fault,list')),
        'late': _late(await _if_known(ask, 'Sim,timing')),
        'flags': ' '.join(flags) or 'none',
    }
    return '\n'.join(f'{name + ":":8}{text}' for name, text in rows.items() if text)


async def _if_known(ask: Ask, command: str) -> str | None:
    """Return the value of the answer, or None if the controller does not know or refuses it."""
    try:
        return await ask(command)
    except RemoteError:
        return None


def _on(bit: Sequence[str], yes: str, no: str) -> str | None:
    return None if not bit else yes if bit[0] == '1' else no


def _estop(flags: Sequence[str], condition: Mapping[str, str]) -> str:
    known = _ESTOP.get(condition.get('estop', ''))
    return known or ('active (release, then reset)' if 'EStop' in flags else 'not active')


def _mode(flags: Sequence[str]) -> str | None:
    modes = {'Auto': 'AUTO', 'Teach': 'TEACH', 'Test': 'TEST'}
    return next((mode for flag, mode in modes.items() if flag in flags), None)


async def _joints(ask: Ask) -> str | None:
    """Return where the joints are, all at one moment, or None if the controller does not tell now.

    No command tells how many joints there are: each is asked for, until there is none.
    """
    values = await _if_known(ask, 'Sim,joints')
    functions: list[str] = []
    while not values and len(functions) < MAX_JOINTS:
        function = f'Agl({len(functions) + 1})'
        if not await _if_known(ask, f'Execute,"Print {function}"'):
            break
        functions.append(function)
    if functions:
        values = await _if_known(ask, f'Execute,"Print {",".join(functions)}"')
    if not values:
        return None
    return _with_units([f'{float(each):.3f}' for each in values.strip(chr(34)).split()])


def _with_units(values: Sequence[str]) -> str:
    """Return joint values with their units: of a SCARA's four joints the third is in mm."""
    if len(values) != SCARA_JOINTS:
        return f'{" ".join(values)} degrees'
    units = ('degrees', 'degrees', 'mm', 'degrees')
    return ', '.join(f'{value} {unit}' for value, unit in zip(values, units, strict=True))


async def _error(ask: Ask, number: int) -> str:
    if not number:
        return 'none'
    known = ERRORS.get(number)
    told = await _if_known(ask, f'GetErrMsg,{number},0')
    text = f'{number:04d} ({told or (known.meaning if known else "see the manual")})'
    return f'{text}: {known.remedy}' if known and known.remedy else text


def _tasks(value: str | None) -> str | None:
    if not value:
        return None
    rows = [part.partition('=')[2].split(',') for part in value.split(';')]
    return _INDENT.join(f'{name:15}{kind:14}{state}' for name, kind, state in rows)


def _faults(value: str | None) -> str | None:
    if value is None:
        return None
    return faults(value).replace('\n', _INDENT) if value else 'none'


def _late(value: str | None) -> str | None:
    """Return what the simulated controller reports about missed deadlines since it was started."""
    if value is None:
        return None
    cycles, plans, failures, violations = value.split(',')
    text = f'{cycles} cycles, {plans} plans; {failures} plans failed'
    return text if violations == '0' else f'{text}; {violations} limit violations averted'
