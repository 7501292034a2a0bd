# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Ask a controller for an action of the pendant, and say what it answered.

Every answer says which controller gave it.
"""

import asyncio
from collections.abc import Sequence
from math import ceil

from epson_driver.driver.inhibit import flags_inhibit
from epson_driver.driver.remedy import Remedy, with_remedy
from epson_driver.error_texts import load_error_texts
from epson_driver.pendant.commands import Request
from epson_driver.pendant.status import status
from epson_driver.remote_ethernet.client import (
    LOGIN_RETRY_PERIOD_S,
    MAX_LOGINS,
    Ask,
    HungUpError,
    RemoteError,
    connected,
    logged_in,
)
from epson_driver.remote_ethernet.errors import RemoteErrorNumber
from epson_driver.remote_ethernet.identity import identity
from epson_driver.remote_ethernet.status_flags import ask_flags

ERROR_TEXTS = 'epson'
"""The table of the error numbers that Remote Ethernet tells."""

WORDS = {
    Remedy.RELEASE_ESTOP: 'release it, then reset',
    Remedy.RESET: 'reset first',
    Remedy.BOOT: 'switch the controller off and on again',
    Remedy.TURN_TO_AUTO: 'turn the key to AUTO first',
    Remedy.CLOSE_SAFEGUARD: 'close it first',
    Remedy.CONTINUE: 'continue, or stop, first',
}
"""What helps, in the pendant's own words."""


class RejectedError(Exception):
    """The controller refuses, for the reason in its text."""


async def ask_controller(
    asked: Request | None, host: str, port: int, password: str, timeout: float
) -> str:
    """Return the controller's answer to an action, or its state for None, and its identity.

    Looking and stopping are tried on another connection when a controller hangs up. Raises
    RejectedError, RemoteError, TimeoutError after `timeout` s, ConnectionError.
    """
    async with asyncio.timeout(timeout):
        while True:
            try:
                return await _once(asked, host, port, password, timeout)
            except HungUpError:
                if asked is not None and not asked.repeatable:
                    raise
                await asyncio.sleep(LOGIN_RETRY_PERIOD_S)


async def _once(asked: Request | None, host: str, port: int, password: str, timeout: float) -> str:
    address = f'{host}:{port}'
    if asked is not None and asked.commands[0].startswith('Sim,'):
        async with connected(host, port, timeout) as ask:
            if await _simulated(ask):
                return await _done(ask, asked, address)
    logins = max(MAX_LOGINS, ceil(timeout / LOGIN_RETRY_PERIOD_S))  # as long as there is time
    async with logged_in(host, port, timeout, password, logins) as ask:
        return await _done(ask, asked, address)


async def _simulated(ask: Ask) -> bool:
    """Return whether the controller is simulated, and needs no login for a person's actions."""
    try:
        await ask('Sim,identity')
    except RemoteError:
        return False
    return True


async def _done(ask: Ask, asked: Request | None, address: str) -> str:
    """Do it, and return the answer and the controller's identity."""
    try:
        if asked is None:
            return await status(ask, await identity(ask, address))
        value = await _first_known(ask, asked.commands)
        done = asked.done if isinstance(asked.done, str) else asked.done(value)
    except (RemoteError, RejectedError) as error:
        raise RejectedError(f'{error} [{await _who(ask, address)}]') from error
    except (ValueError, KeyError) as error:
        raise ConnectionError(f'{address}: an answer makes no sense: {error}') from error
    between = '\n' if '\n' in done else ' '
    return f'{done}{between}[{await _who(ask, address)}]'


async def _who(ask: Ask, address: str) -> str:
    """Return the controller's identity, or only its address if it has hung up."""
    try:
        return await identity(ask, address)
    except ConnectionError:
        return address


async def _first_known(ask: Ask, commands: Sequence[str]) -> str:
    """Send the commands until the controller knows one and return the value of its answer."""
    for command in commands:
        try:
            return await ask(command)
        except RemoteError as error:
            unknown = error.number == RemoteErrorNumber.BAD_COMMAND
            if not unknown or not command.startswith('Sim,'):
                raise RejectedError(await _reason(ask, error)) from error
    raise RejectedError('this is no simulation: it is done by hand, at the controller')


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
    found = flags_inhibit(flags, number, load_error_texts(ERROR_TEXTS))
    if found is not None:
        return f'{with_remedy(found.text, found.remedy, WORDS)} (error {error.number})'
    if 'Running' in flags:
        return f'the arm still moves: try again when it stands (error {error.number})'
    return str(error)
