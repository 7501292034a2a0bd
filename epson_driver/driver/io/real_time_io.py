# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""I/O of an RC800 by the requests of Real-time Motion Control, which it accepts at rest only."""

import struct
from collections.abc import Sequence

from epson_driver.driver.io.points import (
    WORD_GROUPS,
    Backend,
    IoUnavailableError,
    PointReply,
    ranges_of,
)
from epson_driver.link.rtmc_link import RtmcLink
from epson_driver.profiles.io_profile import IoProfile
from epson_driver.rtmc.messages import NUMBER_DATA, Request
from epson_driver.rtmc.session import RefusedError
from epson_driver.simple_message import IoAddress, IoSetting, IoType

BIT, BYTE, WORD = range(3)
"""Ranges of a request, in the second byte of its low word."""

VALUES = (struct.Struct('<B'), struct.Struct('<B'), struct.Struct('<H'))
"""Layout of a value, by range."""

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
