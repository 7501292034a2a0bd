# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Points by MotoROS' I/O messages: general inputs and outputs, one bit or eight at a time.

A reply says nothing of what it answers, so one request is on its way at a time, and after one that
is missing the connection is opened again.
"""

import asyncio
from collections.abc import Callable, Sequence

from epson_driver.driver.io.io_driver import NOT_USED, IoUnavailableError
from epson_driver.driver.io.polled_io import RefusedPointError, Told
from epson_driver.link import Link, LinkState
from epson_driver.simple_message import (
    ByteOrder,
    Dialect,
    IoAddress,
    IoCtrlReply,
    IoSetting,
    IoType,
    Message,
    MotomanIoResult,
    Packet,
    ReadIoBit,
    ReadIoBitReply,
    ReadIoGroup,
    ReadIoGroupReply,
    WriteIoBit,
    WriteIoBitReply,
    WriteIoGroup,
    WriteIoGroupReply,
)
from epson_driver.simple_message.motoman import GENERAL_INPUTS, GENERAL_OUTPUTS, bit_address

FIRST_GROUP = {
    IoType.DIGITAL_INPUT: GENERAL_INPUTS,
    IoType.GROUP_INPUT: GENERAL_INPUTS,
    IoType.DIGITAL_OUTPUT: GENERAL_OUTPUTS,
    IoType.GROUP_OUTPUT: GENERAL_OUTPUTS,
}

GROUPS = (IoType.GROUP_INPUT, IoType.GROUP_OUTPUT)

REPLIES = (ReadIoBitReply, ReadIoGroupReply, WriteIoBitReply, WriteIoGroupReply)


class MotomanIo:
    """The points of one controller. An I/O port of 0 is not used."""

    words = False
    flags = False
    outputs_shown = True

    def __init__(self, host: str, port: int, byte_order: ByteOrder | None) -> None:
        self.timeout = 1.0
        self.missing = '' if port else NOT_USED
        self.place = f'{host}:{port}'
        self.link = Link(
            'io',
            host,
            port,
            on_packet=lambda _packet: None,
            on_state=self._on_link,
            byte_order=byte_order,
            quiet=True,
        )
        self._one = asyncio.Lock()
        self._why = 'connecting'
        self._came: Callable[[], None] = lambda: None
        self._lost: Callable[[str], None] = lambda _why: None
        self._answer: asyncio.Future[Packet] | None = None

    def follow(self, dialect: Dialect) -> None:
        """Write in the byte order and real width of the state server."""
        self.link.follow(dialect)

    async def run(self, came: Callable[[], None], lost: Callable[[str], None]) -> None:
        """Keep the link alive until cancelled."""
        self._came, self._lost = came, lost
        await self.link.run()

    async def read(self, addresses: Sequence[IoAddress]) -> list[Told]:
        """Return a value per address, or why there is none. Raises IoUnavailableError."""
        return [await self._ask(_reading(item), '') for item in addresses]

    async def write(self, settings: Sequence[IoSetting]) -> list[Told]:
        """Set points in their order. Raises IoUnavailableError, which says which may be set."""
        unsure = '; the points may have been written'
        return [await self._ask(_writing(item), unsure) for item in settings]

    async def _ask(self, message: Message, unsure: str) -> Told:
        async with self._one:
            reply = await self._exchange(message, unsure)
        if isinstance(reply, IoCtrlReply):
            return RefusedPointError(f'the controller does not know the request ({reply.subcode})')
        if not isinstance(reply, REPLIES):
            raise IoUnavailableError(f'the reply of the I/O server makes no sense{unsure}')
        if reply.result != MotomanIoResult.OK:
            known = reply.result in list(MotomanIoResult)
            name = MotomanIoResult(reply.result).name if known else 'unknown'
            return RefusedPointError(f'the controller refused it: {name} ({reply.result})')
        return getattr(reply, 'value', 0)

    async def _exchange(self, message: Message, unsure: str) -> Message:
        """Send a request and return its reply. Raises IoUnavailableError."""
        if not self.link.connected:
            raise IoUnavailableError(self._why)
        answer: asyncio.Future[Packet] = asyncio.get_running_loop().create_future()

        def on_reply(packet: Packet, _now: float) -> None:
            if not answer.done():
                answer.set_result(packet)

        self._answer = answer
        try:
            self.link.post(message, on_reply)
            async with asyncio.timeout(self.timeout):
                packet = await answer
        except TimeoutError as error:
            text = f'no reply from the I/O server within {self.timeout:g} s'
            self.link.reconnect(text)
            raise IoUnavailableError(f'{text}{unsure}') from error
        except ConnectionError as error:
            raise IoUnavailableError(f'{error}{unsure}') from error
        except asyncio.CancelledError:
            self.link.reconnect('a request was given up')
            raise
        finally:
            self._answer = None
        return packet.message

    def _on_link(self, state: LinkState, why: str) -> None:
        if state is LinkState.CONNECTED:
            self._came()
            return
        self._why = f'no I/O link: {why}'
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(ConnectionError(f'the I/O link was lost: {why}'))
        if state is LinkState.BACKING_OFF:
            self._lost(self._why)


def _reading(item: IoAddress) -> Message:
    io_type = IoType(item.io_type)
    first = FIRST_GROUP[io_type]
    if io_type in GROUPS:
        return ReadIoGroup(first + item.index)
    return ReadIoBit(bit_address(first, item.index))


def _writing(item: IoSetting) -> Message:
    io_type = IoType(item.io_type)
    first = FIRST_GROUP[io_type]
    if io_type in GROUPS:
        return WriteIoGroup(first + item.index, item.value)
    return WriteIoBit(bit_address(first, item.index), item.value)
