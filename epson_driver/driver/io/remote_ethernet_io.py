# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Points by EPSON's Remote Ethernet: $GetIO, $SetIO and the like, one session for each request.

The controller serves one client at its remote port. The connection is therefore closed after each
request, and commands for the motors have priority. No command exists for reading outputs, so the
statement Print is used. The controller refuses Print and all writes while a task runs or the arm
moves (docs/io.md).
"""

import asyncio
from collections.abc import Sequence
from functools import partial

from epson_driver.driver.io.points import (
    WORD_GROUPS,
    Backend,
    IoUnavailableError,
    Told,
    ranges_of,
)
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.remote_ethernet.client import (
    Ask,
    Login,
    RemoteError,
    RemoteErrorNumber,
    RemoteTurns,
    logged_in,
)
from epson_driver.simple_message import IoAddress, IoSetting, IoType

NOT_READY = (
    'not ready (error 20): the controller takes this only in AUTO, while no task runs, the arm '
    'stands and there is no error'
)

HEXADECIMAL, DECIMAL = 16, 10

READ: dict[IoType, str] = {
    IoType.DIGITAL_INPUT: 'GetIO,{}',
    IoType.DIGITAL_OUTPUT: 'Execute,"Print Oport({})"',
    IoType.FLAG: 'GetMemIO,{}',
}

READ_GROUP = {
    IoType.GROUP_INPUT: ('GetIOByte,{}', 'GetIOWord,{}'),
    IoType.GROUP_OUTPUT: ('Execute,"Print Out({})"', 'Execute,"Print OutW({})"'),
}
"""Commands for groups of 8 and of 16 bits."""

WRITE = {IoType.DIGITAL_OUTPUT: 'SetIO,{},{}', IoType.FLAG: 'SetMemIO,{},{}'}

WRITE_GROUP = ('SetIOByte,{},{:02X}', 'SetIOWord,{},{:04X}')


class RemoteEthernetIo(Backend):
    """The points of one controller. Each request connects and shows if it is available."""

    shown = (IoType.DIGITAL_INPUT,)

    def __init__(
        self, host: str, port: int, turns: RemoteTurns, login: Login | None, profile: IoProfile
    ) -> None:
        self.ranges = ranges_of(profile, words=True, flags=True)
        self._place = f'{host}:{port}'
        self._login = login or partial(logged_in, host, port, max_logins=1)
        self._turns = turns

    async def read(self, addresses: Sequence[IoAddress], timeout: float) -> list[Told]:
        """Return a result for each address. Raises IoUnavailableError if the request fails."""
        return await self._give([_reading(item) for item in addresses], timeout)

    async def write(self, settings: Sequence[IoSetting], timeout: float) -> list[Told]:
        """Write points in order. Raises IoUnavailableError, with `sent` if they may be set."""
        return await self._give([_writing(item) for item in settings], timeout)

    async def _give(self, commands: Sequence[str], timeout: float) -> list[Told]:
        async def dialogue() -> list[Told]:
            async with self._login(timeout * (1 + len(commands))) as ask:
                return [await _told(ask, command, timeout) for command in commands]

        try:
            return await self._turns.patient(dialogue)
        except (RemoteError, OSError, TimeoutError) as error:
            why = str(error) or f'no answer within {timeout:g} s'
            raise IoUnavailableError(f'remote port {self._place}: {why}', sent=True) from error


async def _told(ask: Ask, command: str, timeout: float) -> Told:
    try:
        async with asyncio.timeout(timeout):
            answer = await ask(command)
    except RemoteError as error:
        if error.number == RemoteErrorNumber.NOT_READY:
            return Told(result=0, why=NOT_READY)
        passing = error.number == RemoteErrorNumber.EXECUTING
        return Told(result=0, why=str(error), passing=passing)
    base = DECIMAL if command.startswith('Execute') else HEXADECIMAL
    try:
        return Told(int(answer.strip('" '), base))
    except ValueError as error:
        raise ConnectionError(f"'{answer[:40]}' is no answer to {command}") from error


def _reading(item: IoAddress) -> str:
    io_type = IoType(item.io_type)
    if io_type in READ:
        return READ[io_type].format(item.index)
    size, port = divmod(item.index, WORD_GROUPS)
    return READ_GROUP[io_type][size].format(port)


def _writing(item: IoSetting) -> str:
    io_type = IoType(item.io_type)
    if io_type in WRITE:
        return WRITE[io_type].format(item.index, item.value)
    size, port = divmod(item.index, WORD_GROUPS)
    return WRITE_GROUP[size].format(port, item.value)
