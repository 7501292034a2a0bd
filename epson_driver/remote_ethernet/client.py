# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""EPSON's Remote Ethernet: its error numbers, and a client for motors, reset and status.

    flags, code = (await execute(host, 5000, ['GetStatus'], timeout=2.0))[0].split(',')

The client supports RC700-A, RC90 and later controllers, and the simulated controller. The RC620
does not have Remote Ethernet.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager, suppress
from enum import IntEnum
from functools import partial
from typing import Any, TypeVar

from epson_driver.inputs import printable
from epson_driver.socket_errors import reason


class RemoteErrorNumber(IntEnum):
    """Error numbers of Remote Ethernet (RC+ 5.0 and 8.0 user's guides)."""

    NO_DOLLAR = 10
    BAD_COMMAND = 11
    FORMAT = 12
    PASSWORD = 13
    COUNT = 14
    PARAMETER = 15
    TIMEOUT = 19
    NOT_READY = 20
    EXECUTING = 21
    PASSWORD_NEEDED = 98
    SYSTEM = 99


MEANINGS: dict[int, str] = {
    RemoteErrorNumber.NO_DOLLAR: 'the command does not start with $',
    RemoteErrorNumber.BAD_COMMAND: 'the command is unknown, or no client is logged in',
    RemoteErrorNumber.FORMAT: 'the format of the command is wrong',
    RemoteErrorNumber.PASSWORD: 'the password is wrong',
    RemoteErrorNumber.COUNT: 'the number of requested values is wrong',
    RemoteErrorNumber.PARAMETER: 'a parameter is wrong',
    RemoteErrorNumber.TIMEOUT: 'the controller took too long',
    RemoteErrorNumber.NOT_READY: 'the controller does not accept it in its present condition',
    RemoteErrorNumber.EXECUTING: 'another command is being executed',
    RemoteErrorNumber.PASSWORD_NEEDED: 'a password is needed',
    RemoteErrorNumber.SYSTEM: 'system error or communication error',
}


_MAX_LINE_BYTES = 65_536
_MAX_SHOWN_CHARACTERS = 100  # maximum length of an invalid reply in an error text, characters
MAX_ERROR_DIGITS = 5  # maximum number of digits of an error number in a valid reply
MAX_LOGINS = 5  # a controller without a free session closes the connection
LOGIN_RETRY_PERIOD_S = 0.2  # delay before the next login attempt, s

LOGIN_TIMEOUT_S = 5.0
"""Timeout of one login attempt, s. The operating system repeats a lost connection request at
increasing intervals, so after this time a new attempt is faster."""

Ask = Callable[[str], Awaitable[str]]
"""Function that sends a command, written without its `$`, and returns the value of the reply. The
value contains only printable characters. Raises RemoteError if the command is refused."""

Login = Callable[[float], AbstractAsyncContextManager[Ask]]
"""Function that opens a session and yields an `Ask`. Its argument is the session's timeout, s."""


class RemoteError(Exception):
    """The controller refused a command. `number`, `meaning`: the error number and its meaning."""

    def __init__(self, command: str, number: int) -> None:
        command = without_password(command)
        self.command = command
        self.number = number
        self.meaning = MEANINGS.get(number, 'unknown error number')
        super().__init__(f'{command}: {self.meaning} (error {number})')


async def execute(
    host: str, port: int, commands: Sequence[str], timeout: float, password: str = ''
) -> list[str]:
    """Log in, send commands, log out, and return the values of the replies.

    No login is made if all commands are `Sim,…`.
    """
    if all(command.startswith('Sim,') for command in commands):
        session = connected(host, port, timeout)
    else:
        session = logged_in(host, port, timeout, password)
    async with session as ask:
        return [await ask(command) for command in commands]


@asynccontextmanager
async def connected(
    host: str, port: int, timeout: float, tries: int = MAX_LOGINS
) -> AsyncIterator[Ask]:
    """Open a session without a login, for `$Sim` commands. It lasts at most `timeout` s."""

    async def first_command(ask: Ask) -> None:
        with suppress(RemoteError):  # the refusal of a real controller is also an answer
            await ask('Sim,joints')

    async with asyncio.timeout(timeout):
        ask, writer = await _answering(host, port, first_command, tries)
        try:
            yield ask
        finally:
            writer.close()


@asynccontextmanager
async def logged_in(
    host: str, port: int, timeout: float, password: str = '', max_logins: int = MAX_LOGINS
) -> AsyncIterator[Ask]:
    """Open a session: log in, yield the function that sends commands, and log out.

    `timeout`, s, limits the whole session. The login is repeated, in at most `max_logins`
    attempts, if the controller closes the connection before its answer, or does not answer within
    LOGIN_TIMEOUT_S. Repeating is safe because no command has been sent.

    Raises RemoteError if a command is refused, TimeoutError, HungUpError if the controller closes
    the connection, and ConnectionError if the controller is unreachable or sends an invalid reply.
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
    host: str, port: int, first_command: Callable[[Ask], Awaitable[None]], attempts: int
) -> tuple[Ask, asyncio.StreamWriter]:
    """Connect and send `first_command`, at most `attempts` times.

    `first_command` must not move the arm, because it may be executed more than once.
    """
    while True:
        attempts -= 1
        writer: asyncio.StreamWriter | None = None
        try:
            async with asyncio.timeout(LOGIN_TIMEOUT_S):
                reader, writer = await _connected(host, port)
                ask = partial(_ask_at, f'{host}:{port}', reader, writer)
                await first_command(ask)
            return ask, writer
        except BaseException as error:
            if writer is not None:
                writer.close()
            if not attempts or not isinstance(error, HungUpError | TimeoutError):
                raise
        await asyncio.sleep(LOGIN_RETRY_PERIOD_S)


class HungUpError(ConnectionError):
    """The controller closed the connection, with or without having executed the last command."""


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
        raise ValueError(
            f'{without_password(command)!r} must be one command, a line of printable characters'
        )
    writer.write(f'${command}\r\n'.encode())
    await writer.drain()
    try:
        line = await reader.readline()
    except ValueError as error:
        shown = without_password(command)
        raise ConnectionError(
            f'the reply to {shown} is longer than {_MAX_LINE_BYTES} bytes'
        ) from error
    answer = printable(line.decode(errors='replace').strip())
    if not line.endswith(b'\n'):
        shown = without_password(command)
        raise HungUpError(f'closed by the controller before the reply to {shown}')
    result = answer_to(answer, command)
    if result is None:
        cut = len(answer) > _MAX_SHOWN_CHARACTERS
        shown = f'{answer[:_MAX_SHOWN_CHARACTERS]}…' if cut else answer
        raise ConnectionError(f"'{shown}' is not a reply to {without_password(command)}")
    if isinstance(result, RemoteError):
        raise result
    return result


def answer_to(line: str, command: str) -> str | RemoteError | None:
    """Return the value in a reply to `command`, or its refusal.

    Return None if `line` is no reply to this command.
    """
    name, _, value = line[1:].partition(',')
    number = value.strip()
    if name.lower() == command.partition(',')[0].lower():
        if line[0] == '#':
            return value
        if line[0] == '!' and number.isdecimal() and len(number) <= MAX_ERROR_DIGITS:
            return RemoteError(command, int(number))
    return None


def without_password(command: str) -> str:
    name = command.partition(',')[0]
    return name if name.lower() == 'login' else command


T = TypeVar('T')


class PreemptedError(ConnectionError):
    """A dialogue (sequence of commands) was cancelled or refused because of an urgent dialogue."""

    def __init__(self) -> None:
        super().__init__('the remote port was needed for the motors')


class RemoteTurns:
    """Gives the remote port to one dialogue at a time.

    An urgent dialogue cancels a running dialogue that is not urgent (`patient`).
    """

    def __init__(self) -> None:
        self._lock = asyncio.Lock()
        self._urgent = 0
        self._patient: asyncio.Task[Any] | None = None

    @asynccontextmanager
    async def urgent(self) -> AsyncIterator[None]:
        """Acquire the port.

        This cancels a running `patient` dialogue, and waits for another urgent dialogue.
        """
        self._urgent += 1
        try:
            if self._patient is not None:
                self._patient.cancel()
            async with self._lock:
                yield
        finally:
            self._urgent -= 1

    async def patient(self, dialogue: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Wait for the port, run a dialogue, and return its result."""
        async with self._lock:
            if self._urgent:
                raise PreemptedError
            task = asyncio.create_task(dialogue())
            self._patient = task
            try:
                await asyncio.wait([task])
            finally:
                self._patient = None
                task.cancel()  # has an effect only if the waiting caller was cancelled
                await asyncio.gather(task, return_exceptions=True)
            if task.cancelled():
                raise PreemptedError
            return task.result()
