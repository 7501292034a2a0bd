# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`pendant`: what a person does at the controller, over its remote port.

Every answer says which controller gave it.
"""

import argparse
import asyncio
import sys
from collections.abc import Sequence
from math import ceil

from epson_driver.cli.arguments import PORT, argument, host
from epson_driver.cli.pendant_status import ask_flags, status
from epson_driver.cli.pendant_words import (
    TEXTS,
    Request,
    UsageError,
    completion,
    request,
)
from epson_driver.inputs import number
from epson_driver.remote_ethernet.client import (
    LOGIN_RETRY_PERIOD_S,
    MAX_LOGINS,
    Ask,
    HungUpError,
    RemoteError,
    logged_in,
)
from epson_driver.remote_ethernet.errors import RemoteErrorNumber
from epson_driver.remote_ethernet.identity import identity
from epson_driver.sim_controller.faults.fault_text import describe

ANSWER_TIMEOUT_S = 5.0
TIMEOUT = number(0.1, 3600.0, 's')

_LOCAL = {'fault kinds': describe, 'completion': completion}
"""What needs no controller to be answered."""


class _RejectedError(Exception):
    """The controller refuses; the text says why."""


def main() -> int:
    """Do one action. Return 0 if it was done, 1 if it was refused or nobody answered."""
    parser = _parser()
    args = parser.parse_args()
    said = ' '.join(args.action)
    if said in _LOCAL:
        print(_LOCAL[said]())
        return 0
    try:
        asked = None if said == 'status' else request(args.action)
    except UsageError as error:
        parser.error(str(error))
    try:
        said = asyncio.run(_do(asked, args))
    except _RejectedError as error:
        print(f'refused: {error}', file=sys.stderr)
        return 1
    except RemoteError as error:
        print(f'refused: {error} [{args.host}:{args.port}]', file=sys.stderr)
        return 1
    except TimeoutError:
        print(f'no answer from {args.host}:{args.port} in {args.timeout:g} s', file=sys.stderr)
        return 1
    except ConnectionError as error:
        print(f'no controller: {error}', file=sys.stderr)
        return 1
    print(said)
    return 0


async def _do(asked: Request | None, args: argparse.Namespace) -> str:
    """Return what was done or found out, and by whom. None asks for the state.

    Looking and stopping are tried on another connection when a controller hangs up.
    """
    async with asyncio.timeout(args.timeout):
        while True:
            try:
                return await _once(asked, args)
            except HungUpError:
                if asked is not None and not asked.repeatable:
                    raise
                await asyncio.sleep(LOGIN_RETRY_PERIOD_S)


async def _once(asked: Request | None, args: argparse.Namespace) -> str:
    host, port = args.host, args.port
    address = f'{host}:{port}'
    logins = max(MAX_LOGINS, ceil(args.timeout / LOGIN_RETRY_PERIOD_S))  # as long as there is time
    async with logged_in(host, port, args.timeout, args.password, logins) as ask:
        try:
            if asked is None:
                return await status(ask, await identity(ask, address))
            value = await _first_known(ask, asked.commands)
            done = asked.done if isinstance(asked.done, str) else asked.done(value)
        except (RemoteError, _RejectedError) as error:
            raise _RejectedError(f'{error} [{await _who(ask, address)}]') from error
        except (ValueError, KeyError) as error:
            raise ConnectionError(f'{address}: an answer makes no sense: {error}') from error
        between = '\n' if '\n' in done else ' '
        return f'{done}{between}[{await _who(ask, address)}]'


async def _who(ask: Ask, address: str) -> str:
    """Return who answered; only its address if it has hung up: what was asked has been done."""
    try:
        return await identity(ask, address)
    except ConnectionError:
        return address


async def _first_known(ask: Ask, commands: Sequence[str]) -> str:
    """Send the commands until the controller knows one; return the value of its answer."""
    for command in commands:
        try:
            return await ask(command)
        except RemoteError as error:
            unknown = error.number == RemoteErrorNumber.BAD_COMMAND
            if not unknown or not command.startswith('Sim,'):
                raise _RejectedError(await _reason(ask, error)) from error
    raise _RejectedError('this is no simulation: it is done by hand, at the controller')


async def _reason(ask: Ask, error: RemoteError) -> str:
    """Return why the controller refused: in its own words, or by what its flags show."""
    try:
        if why := await ask('Sim,why'):
            return f'{why} (error {error.number})'
    except RemoteError:  # a real controller
        pass
    if error.number != RemoteErrorNumber.NOT_READY:
        return str(error)
    flags, number = await ask_flags(ask)
    for flag, sentence in (
        ('EStop', 'the E-stop is active: release the E-stop, then reset'),
        ('SError', 'there is a critical error: boot the controller again'),
        ('Safeguard', 'the safeguard door is open: close it first'),
        ('Teach', 'the mode is TEACH: turn the key to AUTO first'),
        ('Error', f'there is error {number:04d}: reset first'),
        ('Paused', 'the tasks are paused: continue, or stop, first'),
        ('Running', 'the arm still moves: try again when it stands'),
    ):
        if flag in flags:
            return f'{sentence} (error {error.number})'
    return str(error)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='epson_driver pendant',
        description='What a person does at the controller.',
        usage='%(prog)s [-h] [--host HOST] [--port PORT] [--password PASSWORD] '
        '[--timeout S] WORD …',
        epilog='\n'.join(['words:', *(f'  {said:26}{text}' for said, text in TEXTS.items())]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        '--host', type=host, default='127.0.0.1', help='the controller (%(default)s)'
    )
    parser.add_argument(
        '--port', type=argument(PORT), default=5000, help='its remote port (%(default)s)'
    )
    parser.add_argument('--password', default='', help='password of the remote port (none)')
    parser.add_argument(
        '--timeout',
        type=argument(TIMEOUT),
        default=ANSWER_TIMEOUT_S,
        metavar='S',
        help='how long to try, s (%(default)g)',
    )
    parser.add_argument('action', nargs='+', metavar='WORD', help='the action, as listed below')
    return parser
