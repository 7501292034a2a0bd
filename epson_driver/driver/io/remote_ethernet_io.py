# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Points by EPSON's Remote Ethernet: $GetIO, $SetIO and the like, one dialogue for each request.

The controller serves one client at its remote port: nothing is kept open, and the motors' commands
go first. Outputs are read with the statement Print, as there is no command for it; that and
setting anything are refused while a task runs or the arm moves (docs/io.md).
"""

import asyncio
from collections.abc import Callable, Sequence
from functools import partial

from epson_driver.driver.io.io_driver import IoUnavailableError
from epson_driver.driver.io.io_results import WORD_GROUPS
from epson_driver.driver.io.polled_io import RefusedPointError, Told
from epson_driver.link import Link
from epson_driver.remote_ethernet.client import Ask, Login, RemoteError, logged_in
from epson_driver.remote_ethernet.errors import RemoteErrorNumber
from epson_driver.remote_ethernet.turns import RemoteTurns
from epson_driver.simple_message import Dialect, IoAddress, IoSetting, IoType

NOT_USED = 'I/O is not used: the port of Remote Ethernet is 0'

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
"""For groups of 8 and of 16."""

WRITE = {IoType.DIGITAL_OUTPUT: 'SetIO,{},{}', IoType.FLAG: 'SetMemIO,{},{}'}

WRITE_GROUP = ('SetIOByte,{},{:02X}', 'SetIOWord,{},{:04X}')


class RemoteEthernetIo:
    """The points of one controller. A remote port of 0 is not used."""

    words = True
    flags = True
    outputs_shown = False
    link: Link | None = None

    def __init__(
        self, host: str, port: int, turns: RemoteTurns, login: Login | None = None
    ) -> None:
        self.timeout = 1.0
        self.missing = '' if port else NOT_USED
        self.place = f'{host}:{port}'
        self._login = login or partial(logged_in, host, port, max_logins=1)
        self._turns = turns

    def follow(self, dialect: Dialect) -> None:
        """Do nothing, as text has no byte order."""

    async def run(self, came: Callable[[], None], lost: Callable[[str], None]) -> None:
        """Nothing is kept open: every request shows whether the controller is there."""
        came()
        await asyncio.Event().wait()

    async def read(self, addresses: Sequence[IoAddress]) -> list[Told]:
        """Return a value per address, or why there is none. Raises IoUnavailableError."""
        return await self._give([_reading(item) for item in addresses], '')

    async def write(self, settings: Sequence[IoSetting]) -> list[Told]:
        """Set points in their order. Raises IoUnavailableError, which says which may be set."""
        commands = [_writing(item) for item in settings]
        return await self._give(commands, '; the points may have been written')

    async def _give(self, commands: Sequence[str], unsure: str) -> list[Told]:
        async def dialogue() -> list[Told]:
            patience = self.timeout * (1 + len(commands))
            async with self._login(patience) as ask:
                return [await self._told(ask, command) for command in commands]

        try:
            return await self._turns.patient(dialogue)
        except (RemoteError, OSError, TimeoutError) as error:
            why = str(error) or f'no answer within {self.timeout:g} s'
            raise IoUnavailableError(f'remote port {self.place}: {why}{unsure}') from error

    async def _told(self, ask: Ask, command: str) -> Told:
        try:
            async with asyncio.timeout(self.timeout):
                answer = await ask(command)
        except RemoteError as error:
            if error.number == RemoteErrorNumber.NOT_READY:
                return RefusedPointError(NOT_READY)
            passing = error.number == RemoteErrorNumber.EXECUTING
            return RefusedPointError(str(error), passing=passing)
        base = DECIMAL if command.startswith('Execute') else HEXADECIMAL
        try:
            return int(answer.strip('" '), base)
        except ValueError as error:
            text = f"'{answer[:40]}' is no answer to {command}"
            raise ConnectionError(text) from error


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
