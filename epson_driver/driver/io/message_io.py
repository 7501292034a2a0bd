# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Access to I/O points by messages: an I/O server (docs/io.md), MotoROS, real-time motion (RC800).

At most one request is pending. A reply of MotoROS does not identify its request. Therefore the
connection is reopened if a reply is missing.
"""

import asyncio
import contextlib
import struct
from collections.abc import Sequence
from typing import TypeVar

from epson_driver.driver.io.points import (
    WORD_GROUPS,
    Backend,
    IoUnavailableError,
    PointReply,
    ranges_of,
)
from epson_driver.link import Link, LinkState
from epson_driver.link.rtmc_link import RtmcLink
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.rtmc.messages import NUMBER_DATA, Request
from epson_driver.rtmc.session import RefusedError
from epson_driver.simple_message import (
    ByteOrder,
    Dialect,
    IoAddress,
    IoSetting,
    IoType,
    Message,
    Packet,
    ReplyCode,
)
from epson_driver.simple_message.io_messages import (
    IoInfo,
    IoInfoReply,
    IoRead,
    IoReadReply,
    IoWrite,
    IoWriteReply,
)
from epson_driver.simple_message.motoman import (
    GENERAL_INPUTS,
    GENERAL_OUTPUTS,
    IoCtrlReply,
    MotomanIoResult,
    ReadIoBit,
    ReadIoBitReply,
    ReadIoGroup,
    ReadIoGroupReply,
    WriteIoBit,
    WriteIoBitReply,
    WriteIoGroup,
    WriteIoGroupReply,
    bit_address,
)

MAX_MESSAGE_ID = 2**31 - 1

REFUSED = (
    'the controller refused the I/O request: its I/O server is stopped (E-stop, stop or pause), '
    'or does not support I/O requests'
)
NO_SENSE = 'invalid reply of the I/O server'

R = TypeVar('R', IoInfoReply, IoReadReply, IoWriteReply)


class MessageIo(Backend):
    link: Link

    def __init__(self, host: str, port: int, byte_order: ByteOrder | None) -> None:
        self.link = Link(
            'io',
            host,
            port,
            on_packet=lambda _packet: None,
            on_state=self._on_link,
            byte_order=byte_order,
            quiet=True,
        )
        self._lock = asyncio.Lock()
        self._why = 'connecting'
        self._answer: asyncio.Future[Packet] | None = None
        self._dialect_known = asyncio.Event()
        if byte_order is not None:
            self._dialect_known.set()

    def follow(self, dialect: Dialect) -> None:
        """Use the state server's byte order, as the I/O server shows its order only in replies."""
        self.link.follow(dialect)
        self._dialect_known.set()

    async def _exchange(self, message: Message, timeout: float) -> Packet:
        """Send a request and return its reply. A reply after `timeout` s is ignored."""
        async with self._lock:
            if self.link.connected and not self._dialect_known.is_set():
                with contextlib.suppress(TimeoutError):  # no state message: keep the byte order
                    async with asyncio.timeout(timeout):
                        await self._dialect_known.wait()
                self._dialect_known.set()
            if self.link.transport is None:
                raise IoUnavailableError(self._why)
            answer: asyncio.Future[Packet] = asyncio.get_running_loop().create_future()

            def on_reply(packet: Packet, _now: float) -> None:
                if not answer.done():
                    answer.set_result(packet)

            try:
                waiting = self.link.post(message, on_reply)
            except ConnectionError as error:
                raise IoUnavailableError(f'the I/O request could not be sent: {error}') from error
            self._answer = answer
            try:
                async with asyncio.timeout(timeout):
                    return await answer
            except TimeoutError as error:
                text = f'no reply from the I/O server within {timeout:g} s'
                raise IoUnavailableError(text, sent=True) from error
            except ConnectionError as error:
                raise IoUnavailableError(str(error), sent=True) from error
            finally:
                self._answer = None
                if answer.cancelled() and waiting.sequence is None:
                    self._why = 'no I/O link: a reply is missing'
                    self.link.reconnect('a reply is missing')
                elif answer.cancelled():
                    self.link.give_up(waiting)

    def _on_link(self, state: LinkState, why: str) -> None:
        if state in (LinkState.BACKING_OFF, LinkState.DISCONNECTED):
            self._why = f'no I/O link: {why}'
            if self._answer is not None and not self._answer.done():
                self._answer.set_exception(ConnectionError(self._why))
        if state in (LinkState.CONNECTED, LinkState.BACKING_OFF):
            self.wake()


class ServerIo(MessageIo):
    shown = (
        IoType.DIGITAL_INPUT,
        IoType.DIGITAL_OUTPUT,
        IoType.ANALOG_INPUT,
        IoType.ANALOG_OUTPUT,
        IoType.GROUP_INPUT,
        IoType.GROUP_OUTPUT,
    )

    def __init__(self, host: str, port: int, byte_order: ByteOrder | None) -> None:
        super().__init__(host, port, byte_order)
        self._last_id = 0
        self._connection = 0

    async def find_ranges(self, timeout: float) -> None:
        """Request the list of existing points, once per connection.

        Groups of 16 bits identify this project's server. No other server packs digital points into
        groups.
        """
        connection = self.link.statistics.connections
        if connection != self._connection or self.ranges is None:
            reply = await self._ask(IoInfo(self._next_id()), IoInfoReply, timeout)
            self.ranges, self._connection = reply.items, connection
            self.grouped = any(item.start == WORD_GROUPS for item in reply.items)

    async def read(self, addresses: Sequence[IoAddress], timeout: float) -> list[PointReply]:
        message = IoRead(self._next_id(), tuple(addresses))
        reply = await self._ask(message, IoReadReply, timeout)
        _check_addresses(reply, addresses)
        return [PointReply(item.value, item.result) for item in reply.items]

    async def write(self, settings: Sequence[IoSetting], timeout: float) -> list[PointReply]:
        message = IoWrite(self._next_id(), tuple(settings))
        reply = await self._ask(message, IoWriteReply, timeout)
        _check_addresses(reply, settings)
        return [PointReply(result=item.result) for item in reply.items]

    def _next_id(self) -> int:
        self._last_id = self._last_id % (MAX_MESSAGE_ID - 1) + 1
        return self._last_id

    async def _ask(self, message: Message, kind: type[R], timeout: float) -> R:
        packet = await self._exchange(message, timeout)
        if packet.reply_code is not ReplyCode.SUCCESS:
            raise IoUnavailableError(REFUSED)
        if not isinstance(packet.message, kind):
            raise IoUnavailableError(NO_SENSE, sent=True)
        return packet.message


def _check_addresses(
    reply: IoReadReply | IoWriteReply, requested: Sequence[IoAddress | IoSetting]
) -> None:
    points = [(item.io_type, item.index) for item in reply.items]
    if points != [(item.io_type, item.index) for item in requested]:
        raise IoUnavailableError(
            'the points in the reply of the I/O server are not the requested ones', sent=True
        )


FIRST_GROUP = {
    IoType.DIGITAL_INPUT: GENERAL_INPUTS,
    IoType.GROUP_INPUT: GENERAL_INPUTS,
    IoType.DIGITAL_OUTPUT: GENERAL_OUTPUTS,
    IoType.GROUP_OUTPUT: GENERAL_OUTPUTS,
}

GROUP_TYPES = (IoType.GROUP_INPUT, IoType.GROUP_OUTPUT)

REPLIES = (ReadIoBitReply, ReadIoGroupReply, WriteIoBitReply, WriteIoGroupReply)


class MotomanIo(MessageIo):
    """Access to the general inputs and outputs through MotoROS, with one request per point."""

    shown = (IoType.DIGITAL_INPUT, IoType.DIGITAL_OUTPUT)

    def __init__(
        self, host: str, port: int, byte_order: ByteOrder | None, profile: IoProfile
    ) -> None:
        super().__init__(host, port, byte_order)
        self.ranges = ranges_of(profile, words=False, flags=False)

    async def read(self, addresses: Sequence[IoAddress], timeout: float) -> list[PointReply]:
        return [await self._ask(_reading(item), timeout) for item in addresses]

    async def write(self, settings: Sequence[IoSetting], timeout: float) -> list[PointReply]:
        replies: list[PointReply] = []
        try:
            for item in settings:
                replies.append(await self._ask(_writing(item), timeout))  # noqa: PERF401 - counted
        except IoUnavailableError as error:
            error.sent |= bool(replies)
            raise
        return replies

    async def _ask(self, message: Message, timeout: float) -> PointReply:
        reply = (await self._exchange(message, timeout)).message
        if isinstance(reply, IoCtrlReply):
            why = f'the controller does not know the request ({reply.subcode})'
            return PointReply(result=0, why=why)
        if not isinstance(reply, REPLIES):
            raise IoUnavailableError(NO_SENSE, sent=True)
        if reply.result != MotomanIoResult.OK:
            known = reply.result in list(MotomanIoResult)
            name = MotomanIoResult(reply.result).name if known else 'unknown'
            return PointReply(result=0, why=f'the controller refused it: {name} ({reply.result})')
        return PointReply(getattr(reply, 'value', 0))


def _reading(item: IoAddress) -> Message:
    io_type = IoType(item.io_type)
    first = FIRST_GROUP[io_type]
    if io_type in GROUP_TYPES:
        return ReadIoGroup(first + item.index)
    return ReadIoBit(bit_address(first, item.index))


def _writing(item: IoSetting) -> Message:
    io_type = IoType(item.io_type)
    first = FIRST_GROUP[io_type]
    if io_type in GROUP_TYPES:
        return WriteIoGroup(first + item.index, item.value)
    return WriteIoBit(bit_address(first, item.index), item.value)


BIT, BYTE, WORD = range(3)
"""Codes for the size of a value. A request has the code in the second byte of its number."""

VALUES = (struct.Struct('<B'), struct.Struct('<B'), struct.Struct('<H'))
"""Layouts of a value of size BIT, BYTE and WORD."""

MOVING = 'the arm moves, and Real-time Motion Control accepts I/O requests at rest only'


class RealTimeIo(Backend):
    shown = (IoType.DIGITAL_INPUT, IoType.DIGITAL_OUTPUT)

    def __init__(self, link: RtmcLink, profile: IoProfile) -> None:
        self.ranges = ranges_of(profile, words=True, flags=False)
        self._link = link

    async def read(self, addresses: Sequence[IoAddress], timeout: float) -> list[PointReply]:
        return [await self._ask(item, None) for item in addresses]

    async def write(self, settings: Sequence[IoSetting], timeout: float) -> list[PointReply]:
        return [await self._ask(item, item.value) for item in settings]

    async def _ask(self, item: IoAddress | IoSetting, value: int | None) -> PointReply:
        inputs = item.io_type in (IoType.DIGITAL_INPUT, IoType.GROUP_INPUT)
        number, width = item.index, BIT
        if item.io_type in (IoType.GROUP_INPUT, IoType.GROUP_OUTPUT):
            words, number = divmod(item.index, WORD_GROUPS)
            width = WORD if words else BYTE
        request, data = Request.INPUTS if inputs else Request.OUTPUTS, b'\0'
        if value is not None:
            request, data = Request.SET_OUTPUTS, VALUES[width].pack(value)
        if self._link.moves:
            return PointReply(result=0, why=MOVING, passing=True)
        try:
            reply = await self._link.ask(request, number | width << 8, data)
        except RefusedError as error:
            return PointReply(result=0, why=str(error), passing=True)
        except (OSError, TimeoutError) as error:
            why = str(error) or 'no reply'
            raise IoUnavailableError(f'real-time motion: {why}', sent=True) from error
        return PointReply() if value is not None else PointReply(*reply.values(NUMBER_DATA))
