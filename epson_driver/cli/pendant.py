# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`pendant`: a person's actions at a controller. Each answer names the controller."""

import argparse
import asyncio
import sys
from contextlib import suppress

from epson_driver.cli.arguments import LOGIN_HELP, PORT, argument, help_texts, host
from epson_driver.driver.inhibit import flags_inhibit
from epson_driver.driver.remedy import with_remedy
from epson_driver.error_texts import load_error_texts
from epson_driver.inputs import number
from epson_driver.remote_ethernet.answers import ask_flags, identity
from epson_driver.remote_ethernet.client import (
    LOGIN_RETRY_PERIOD_S,
    MAX_LOGINS,
    Ask,
    HungUpError,
    RemoteError,
    RemoteErrorNumber,
    connected,
    logged_in,
)
from epson_driver.remote_ethernet.hand import (
    ACTIONS,
    FORMS,
    Action,
    RefusedError,
    UsageError,
    action,
    do,
    told,
)
from epson_driver.sim_controller.faults.fault_kinds import describe

STATUS, KINDS = 'status', 'fault kinds'
WORDS = {STATUS: 'state of the controller', KINDS: 'list the kinds of faults', **FORMS}
WORDS |= {words: each.done or 'list all' for words, each in ACTIONS.items()}


def main() -> int:
    """Do one action. Returns 0 if it was done, 1 if it was refused or not answered."""
    parser = argparse.ArgumentParser(
        prog='epson_driver pendant',
        **help_texts(
            'Perform operator actions at a controller.',
            ('pendant status', 'pendant --port 5000 estop press'),
            '0 done, 1 refused or no answer, 2 invalid arguments',
            '\n'.join(('\nactions:', *(f'  {name:26}{text}' for name, text in WORDS.items()))),
        ),
        allow_abbrev=False,
    )
    port, time = argument(PORT), argument(number(0.1, 3600.0, 's'))
    parser.add_argument(
        '--host', type=host, default='127.0.0.1', help='controller address (default: %(default)s)'
    )
    parser.add_argument(
        '--port', type=port, default=5000, help='remote port (default: %(default)s)'
    )
    parser.add_argument('--password', default='', help=LOGIN_HELP)
    parser.add_argument(
        '--timeout', type=time, default=5.0, help='time limit, s (default: %(default)g)'
    )
    parser.add_argument('words', nargs='+', metavar='WORD', help='action, see below')
    given = parser.parse_args()
    message, address = ' '.join(given.words), f'{given.host}:{given.port}'
    if message == KINDS:
        print(describe())
        return 0
    try:
        asked = Action((), stops=True) if message == STATUS else action(message)
        print(asyncio.run(_ask(asked, message, given)))
    except UsageError as error:
        parser.error(str(error))
    except RemoteError as error:
        print(f'refused: {error} [{address}]', file=sys.stderr)
    except RefusedError as error:
        print(f'refused: {error}', file=sys.stderr)
    except TimeoutError:
        print(f'no answer from {address} in {given.timeout:g} s', file=sys.stderr)
    except ConnectionError as error:
        print(f'no controller: {error}', file=sys.stderr)
    else:
        return 0
    return 1


async def _ask(asked: Action, command: str, given: argparse.Namespace) -> str:
    """Return the answer and its controller. Queries and stops are retried after a disconnect."""
    place, tries = (given.host, given.port, given.timeout), round(given.timeout / 0.2)
    async with asyncio.timeout(given.timeout):
        while True:
            try:
                if asked.commands and asked.commands[0].startswith('Sim,'):
                    async with connected(*place) as ask:  # which needs no login
                        if await told(ask, 'Sim,identity'):
                            return await _done(ask, asked, command, f'{given.host}:{given.port}')
                async with logged_in(*place, given.password, max(MAX_LOGINS, tries)) as ask:
                    return await _done(ask, asked, command, f'{given.host}:{given.port}')
            except HungUpError:
                if asked.done and not asked.stops:
                    raise
                await asyncio.sleep(LOGIN_RETRY_PERIOD_S)


async def _done(ask: Ask, asked: Action, command: str, address: str) -> str:
    """Do it, and return the answer and the controller's identity."""
    try:
        if asked.commands:
            value = (await do(ask, asked)).replace(';', '\n') or 'none'
        else:
            value = await _status(ask)
    except RefusedError as error:
        raise RefusedError(f'{await _reason(ask, error)} [{await _who(ask, address)}]') from error
    return f'{asked.done or f"{command}: {value}"} [{await _who(ask, address)}]'


async def _who(ask: Ask, address: str) -> str:
    """Return the controller's identity, or only its address if it has disconnected."""
    try:
        return await identity(ask, address)
    except ConnectionError:
        return address


async def _reason(ask: Ask, error: RefusedError) -> str:
    """Return why the controller refused: in its own words, or from its flags."""
    text = str(error)
    with suppress(RemoteError):
        if error.number == RemoteErrorNumber.NOT_READY and not error.explained:
            flags, shown = await ask_flags(ask)
            if result := flags_inhibit(flags, shown, load_error_texts()):
                text = with_remedy(result.text, result.remedy, {})
            elif 'Running' in flags:
                text = 'the arm is still moving: try again when it has stopped'
    number = f' (error {error.number})'
    return text if not error.number or number in text else text + number


async def _status(ask: Ask) -> str:
    """Return the full state report of a controller, real or simulated, as rows of text."""
    flags, shown = await ask_flags(ask)
    texts, motor = load_error_texts(), (await told(ask, 'GetMotor,0')).split(',')
    condition, names = await told(ask, 'Sim,condition'), ('joints', 'tasks', 'timing', 'fault')
    rows = [condition.replace(';', '\n') or f'motors={"".join(motor[1:2])}']
    if result := flags_inhibit(flags, shown, texts):
        rows.append(f'state={with_remedy(result.text, result.remedy, {})}')
    if shown:
        rows.append(f'error={texts.phrase(shown)}: {texts.advice(shown, "see the manual")}')
    rows.append(f'flags={" ".join(flags)}')
    parts = {name: await told(ask, f'Sim,{name}') for name in names}
    rows += [f'{name}: {item}'.replace(';', '\n') for name, item in parts.items() if item]
    return '\n'.join(rows)
