# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A client of EPSON's Remote Ethernet: motors, reset and status from afar.

    flags, code = (await execute(host, 5000, ['GetStatus'], timeout=2.0))[0].split(',')

It works with RC700-A, RC90 and later controllers, and with the simulated one; the RC620 itself
has no such port.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager, suppress
from functools import partial

from epson_driver.inputs import printable
from epson_driver.remote_ethernet.errors import MEANINGS
from epson_driver.socket_errors import reason

_MAX_LINE_BYTES = 65_536
_MAX_SHOWN_CHARACTERS = 100
"""How much of a wrong answer an error text shows, characters."""
MAX_ERROR_DIGITS = 5
"""At most, of an error number. (`int` raises ValueError for more than 4,300.)"""

MAX_LOGINS = 5
"""How often a login is tried on a controller that hangs up: its places may all be taken."""

LOGIN_RETRY_PERIOD_S = 0.2
"""How long after a controller hung up the next login is tried, s."""

LOGIN_TIMEOUT_S = 5.0
"""How long a login may take before it is tried on another connection, s. The system repeats ever
more rarely what a full queue of connections did not take."""

Ask = Callable[[str], Awaitable[str]]
"""Gives a command without its `$`; returns the value of the answer, or raises RemoteError.

The value is printable, as `inputs.printable` has it, whatever the controller sends.
"""


Login = Callable[[float], AbstractAsyncContextManager[Ask]]
"""Lets one ask for so long, s, as `logged_in` does."""


class RemoteError(Exception):
    """The controller's refusal: `command` as it was sent, `number`, and its `meaning` in words.

    Of a login only the name is kept, not the password.
    """

    def __init__(self, command: str, number: int) -> None:
        command = without_password(command)
        self.command = command
        self.number = number
        self.meaning = MEANINGS.get(number, 'unknown error number')
        super().__init__(f'{command}: {self.meaning} (error {number})')


async def execute(
    host: str, port: int, commands: Sequence[str], timeout: float, password: str = ''
) -> list[str]:
    """Log in, give the commands in order, log out, and return the value of each answer.

    Without the login if all of them are for a simulation (`Sim,…`). Commands are written without
    their `$`, as in `'SetMotorsOn,1'`. Raises what `logged_in` does; nothing is given any more
    after the first command that is refused.
    """
    if all(command.startswith('Sim,') for command in commands):
        session = connected(host, port, timeout)
    else:
        session = logged_in(host, port, timeout, password)
    async with session as ask:
        return [await ask(command) for command in commands]


@asynccontextmanager
async def connected(host: str, port: int, timeout: float) -> AsyncIterator[Ask]:
    """Be connected without a login, which `$Sim` does not need. As `logged_in` otherwise."""

    async def greet(ask: Ask) -> None:
        with suppress(RemoteError):  # as of a real controller: it answers
            await ask('Sim,joints')

    async with asyncio.timeout(timeout):
        ask, writer = await _answering(host, port, greet, MAX_LOGINS)
        try:
            yield ask
        finally:
            writer.close()


@asynccontextmanager
async def logged_in(
    host: str, port: int, timeout: float, password: str = '', max_logins: int = MAX_LOGINS
) -> AsyncIterator[Ask]:
    """Be logged in for several commands with one `timeout`, s, for all.

    A controller that hangs up before the login is answered, or takes LOGIN_TIMEOUT_S for it, is
    tried again, `max_logins` times in all: nothing was asked of it yet. One that hangs up at the
    logout, or refuses it while it executes what another client gave, has answered everything.

    Raises RemoteError for a command that is refused, TimeoutError if all together took longer
    than `timeout`, HungUpError if the controller hangs up, and ConnectionError if it cannot be
    reached or answers something else.
    """

    async def login(ask: Ask) -> None:
        await ask(f'Login,{password}')

    async with asyncio.timeout(timeout):
        ask, writer = await _answering(host, port, login, max_logins)
        try:
            yield ask
            with suppress(HungUpError, RemoteError):
                await ask('Logout')
        finally:
            writer.close()


async def _answering(
    host: str, port: int, greet: Callable[[Ask], Awaitable[None]], tries: int
) -> tuple[Ask, asyncio.StreamWriter]:
    """Return a connection on which a greeting, which moves nothing, was answered."""
    while True:
        tries -= 1
        writer: asyncio.StreamWriter | None = None
        try:
            async with asyncio.timeout(LOGIN_TIMEOUT_S):
                reader, writer = await _connected(host, port)
                ask = partial(_ask_at, f'{host}:{port}', reader, writer)
                await greet(ask)
            return ask, writer
        except BaseException as error:
            if writer is not None:
                writer.close()
            if not tries or not isinstance(error, HungUpError | TimeoutError):
                raise
        await asyncio.sleep(LOGIN_RETRY_PERIOD_S)


class HungUpError(ConnectionError):
    """The controller closed the connection, whether or not it did what was asked last."""


async def _connected(host: str, port: int) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    try:
        return await asyncio.open_connection(host, port, limit=_MAX_LINE_BYTES)
    except ConnectionResetError as error:
        raise HungUpError(f'{host}:{port}: {reason(error)}') from error
    except (OSError, OverflowError, ValueError) as error:
        raise ConnectionError(f'{host}:{port}: {reason(error)}') from error


async def _ask_at(
    where: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, command: str
) -> str:
    try:
        return await _ask(reader, writer, command)
    except (HungUpError, ConnectionResetError, BrokenPipeError) as error:
        raise HungUpError(f'{where}: {error}') from error
    except ConnectionError as error:
        raise ConnectionError(f'{where}: {error}') from error


async def _ask(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, command: str) -> str:
    if not command.isprintable():
        raise ValueError(f'{without_password(command)!r} is not one command')
    writer.write(f'${command}\r\n'.encode())
    await writer.drain()
    try:
        line = await reader.readline()
    except ValueError as error:
        shown = without_password(command)
        raise ConnectionError(f'the answer to {shown} does not end') from error
    answer = printable(line.decode(errors='replace').strip())
    if not line.endswith(b'\n'):
        shown = without_password(command)
        raise HungUpError(f'closed by the controller before it answered {shown}')
    name, _, value = answer[1:].partition(',')
    if name.lower() == command.partition(',')[0].lower():
        if answer.startswith('#'):
            return value
        if answer.startswith('!') and value.isdecimal() and len(value) <= MAX_ERROR_DIGITS:
            raise RemoteError(command, int(value))
    shown = (
        answer if len(answer) <= _MAX_SHOWN_CHARACTERS else f'{answer[:_MAX_SHOWN_CHARACTERS]}…'
    )
    raise ConnectionError(f"'{shown}' is no answer to {without_password(command)}")


def without_password(command: str) -> str:
    """Return a command as it may be shown."""
    name = command.partition(',')[0]
    return name if name.lower() == 'login' else command
