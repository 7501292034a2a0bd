# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A client of EPSON's Remote Ethernet: motors, reset and status from afar.

    flags, code = (await execute(host, 5000, ['GetStatus'], timeout=2.0))[0].split(',')

It works with RC700-A, RC90 and later controllers, and with the simulated one; the RC620 itself
has no such port.
"""

import asyncio
import os
from collections.abc import Sequence

from epson_driver.remote_errors import MEANINGS

_LONGEST_LINE = 4096


class RemoteError(Exception):
    """The controller's refusal: `command` as it was sent, `number`, and its `meaning` in words."""

    def __init__(self, command: str, number: int) -> None:
        self.command = command
        self.number = number
        self.meaning = MEANINGS.get(number, 'unknown error number')
        super().__init__(f'{command}: {self.meaning} (error {number})')


async def execute(
    host: str, port: int, commands: Sequence[str], timeout: float, password: str = ''
) -> list[str]:
    """Log in, give the commands one after the other, log out; return the value of each answer.

    Commands are written without their `$`, as in `'SetMotorsOn,1'`. Raises RemoteError at the
    first one that is refused, TimeoutError if all together took longer than `timeout` s, and
    ConnectionError if the controller cannot be reached, hangs up or answers something else.
    """
    async with asyncio.timeout(timeout):
        try:
            reader, writer = await asyncio.open_connection(host, port, limit=_LONGEST_LINE)
        except (OSError, OverflowError) as error:
            raise ConnectionError(f'{host}:{port}: {_reason(error)}') from error
        try:
            await _ask(reader, writer, f'Login,{password}')
            values = [await _ask(reader, writer, command) for command in commands]
            await _ask(reader, writer, 'Logout')
        except ConnectionError as error:
            raise ConnectionError(f'{host}:{port}: {error}') from error
        finally:
            writer.close()
    return values


def _reason(error: OSError | OverflowError) -> str:
    number = error.errno if isinstance(error, OSError) else None
    # asyncio's text names the address again; a name that is not found has a negative number.
    return os.strerror(number) if number is not None and number > 0 else str(error)


async def _ask(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, command: str) -> str:
    if not command.isprintable():
        raise ValueError(f'{command!r} is not one command')
    writer.write(f'${command}\r\n'.encode())
    await writer.drain()
    try:
        line = await reader.readline()
    except ValueError as error:
        raise ConnectionError(f'the answer to {command} does not end') from error
    answer = line.decode(errors='replace').strip()
    if not line.endswith(b'\n'):
        raise ConnectionError(f'closed by the controller before it answered {command}')
    name, _, value = answer[1:].partition(',')
    if name.lower() == command.partition(',')[0].lower():
        if answer.startswith('#'):
            return value
        if answer.startswith('!') and value.isdecimal():
            raise RemoteError(command, int(value))
    raise ConnectionError(f'{answer!r} is no answer to {command}')
