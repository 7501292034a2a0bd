# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver pendant`: operator actions at a controller, which each line of output names."""

import argparse
import asyncio
import sys
from contextlib import suppress

from epson_driver.cli.arguments import (
    PORT,
    Parser,
    add_password,
    host,
    parsed,
)
from epson_driver.driver.inhibit import flags_inhibit
from epson_driver.driver.remedy import with_remedy
from epson_driver.error_texts import load_error_texts
from epson_driver.inputs import InputError, number
from epson_driver.remote_ethernet import client, hand
from epson_driver.remote_ethernet.answers import ask_flags, identity
from epson_driver.remote_ethernet.client import Ask, HungUpError, RemoteError
from epson_driver.setup.robot_file import password_in
from epson_driver.sim_controller.faults.fault_kinds import describe

STATUS, KINDS = 'status', 'fault kinds'
MOVING = 'the arm is still moving: try again when it has stopped'


def main() -> int:
    more = {STATUS: 'state of the controller', KINDS: 'list the kinds of faults'}
    actions = f'\nactions (*: only at a simulated controller):\n{hand.overview(more)}'
    parser = Parser(
        'pendant',
        'Perform operator actions at a controller.',
        ('pendant status', 'pendant --port 5000 estop press'),
        '0 done, 1 refused or no answer, 2 invalid arguments, 130 Ctrl-C',
        actions,
    )
    parser.option('--host ADDRESS', 'address of the controller', host, '127.0.0.1')
    parser.option('--port PORT', 'remote port', PORT, 5000)
    parser.option('--timeout S', 'time limit, s', number(0.1, 3600.0, 's'), 5)
    add_password(parser)
    parser.add_argument('words', nargs='+', metavar='WORD', help='action, see below')
    arguments = parsed(parser)
    message, address = ' '.join(arguments.words), f'{arguments.host}:{arguments.port}'
    remedy = f'check --host and --port, or run `epson_driver doctor {arguments.host}`'
    if message == KINDS:
        print(describe())
        return 0
    try:
        arguments.password = password_in(arguments.password_variable, '')
        requested = hand.Action((), stops=True) if message == STATUS else hand.action(message)
        print(asyncio.run(_perform(requested, message, arguments)))
    except (InputError, hand.UsageError) as error:
        parser.error(str(error))
    except RemoteError as error:
        print(f'refused: {error} [{address}]', file=sys.stderr)
    except hand.RefusedError as error:
        print(f'refused: {error}', file=sys.stderr)
    except TimeoutError:
        text = f'no answer from {address} in {arguments.timeout:g} s; end its other clients'
        print(f'{text}, {remedy}', file=sys.stderr)
    except ConnectionError as error:
        print(f'no controller: {error}; {remedy}', file=sys.stderr)
    else:
        return 0
    return 1


async def _perform(requested: hand.Action, command: str, arguments: argparse.Namespace) -> str:
    """Perform an action and return the text to print.

    After a disconnect, only queries and stops are repeated.
    """
    place = (arguments.host, arguments.port, arguments.timeout)
    address = f'{arguments.host}:{arguments.port}'
    tries = max(client.MAX_LOGINS, round(arguments.timeout / 0.2))
    async with asyncio.timeout(arguments.timeout):
        while True:
            try:
                if requested.commands and requested.commands[0].startswith('Sim,'):
                    async with client.connected(*place, tries) as ask:  # $Sim needs no login
                        if await hand.value_or_empty(ask, 'Sim,identity'):
                            return await _result(ask, requested, command, address)
                async with client.logged_in(*place, arguments.password, tries) as ask:
                    return await _result(ask, requested, command, address)
            except HungUpError:
                if requested.done and not requested.stops:
                    raise
                await asyncio.sleep(client.LOGIN_RETRY_PERIOD_S)


async def _result(ask: Ask, requested: hand.Action, command: str, address: str) -> str:
    try:
        if requested.commands:
            value = (await hand.do(ask, requested)).replace(';', '\n') or 'none'
        else:
            value = await _status(ask)
    except hand.RefusedError as error:
        why = f'{await _reason(ask, error)} [{await _who(ask, address)}]'
        raise hand.RefusedError(why) from error
    return f'{requested.done or f"{command}: {value}"} [{await _who(ask, address)}]'


async def _who(ask: Ask, address: str) -> str:
    try:
        return await identity(ask, address)
    except ConnectionError:
        return address


async def _reason(ask: Ask, error: hand.RefusedError) -> str:
    """Return why a controller refused. Its flags explain error NOT_READY."""
    with suppress(RemoteError):
        flags, shown = await ask_flags(ask) if error.number else ((), 0)
        text = MOVING if 'Running' in flags else ''
        if result := flags_inhibit(flags, shown, load_error_texts()):
            text = with_remedy(result.text, result.remedy, {})
        if text:
            return f'{text} (error {error.number})'
    return str(error)


async def _status(ask: Ask) -> str:
    flags, shown = await ask_flags(ask)
    texts, motor = load_error_texts(), (await hand.value_or_empty(ask, 'GetMotor,0')).split(',')
    condition = await hand.value_or_empty(ask, 'Sim,condition')
    rows = [condition.replace(';', '\n') or f'motors={"".join(motor[1:2])}']
    if result := flags_inhibit(flags, shown, texts):
        rows.append(f'state={with_remedy(result.text, result.remedy, {})}')
    if shown:
        rows.append(f'error={texts.phrase(shown)}: {texts.advice(shown, "see the manual")}')
    rows.append(f'flags={" ".join(flags)}')
    rows += [
        f'{name}: {item}'.replace(';', '\n')
        for name in ('joints', 'tasks', 'timing', 'fault')
        if (item := await hand.value_or_empty(ask, f'Sim,{name}'))
    ]
    return '\n'.join(rows)
