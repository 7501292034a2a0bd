# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Converts frames to packets. The layouts convert packets to bytes."""

import struct

from epson_driver.simple_message.constants import (
    BodyError,
    ByteOrder,
    CommType,
    Dialect,
    HeaderError,
    Real,
    ReplyCode,
)
from epson_driver.simple_message.framer import (
    HEADER_SIZE,
    MAX_LENGTH,
    PREFIX_SIZE,
    Frame,
    Framer,
)
from epson_driver.simple_message.layouts import (
    LAYOUT_OF_CLASS,
    LAYOUT_OF_REPLY,
    LAYOUT_OF_TYPE,
    NEW,
    BodyReader,
    FixedLayout,
    Packet,
)
from epson_driver.simple_message.messages import Message, Opaque


def check_header(frame: Frame) -> tuple[CommType, ReplyCode]:
    """Return the checked fields of a header. Raises HeaderError if one violates REP-I0006."""
    if frame.msg_type <= 0:
        raise HeaderError('msg_type', frame.msg_type, 'must be positive (0 is reserved)')
    if frame.comm_type not in (CommType.TOPIC, CommType.SERVICE_REQUEST, CommType.SERVICE_REPLY):
        raise HeaderError(
            'comm_type', frame.comm_type, 'must be 1 (topic), 2 (request) or 3 (reply)'
        )
    comm_type = CommType(frame.comm_type)
    if comm_type is CommType.SERVICE_REPLY:
        if frame.reply_code not in (ReplyCode.SUCCESS, ReplyCode.FAILURE):
            raise HeaderError(
                'reply_code', frame.reply_code, 'must be 1 (success) or 2 (failure) in a reply'
            )
    elif frame.reply_code != ReplyCode.INVALID:
        raise HeaderError('reply_code', frame.reply_code, 'must be 0 in topics and requests')
    return comm_type, ReplyCode(frame.reply_code)


def decode(frame: Frame) -> Packet:
    """Return the packet of a frame.

    A message of unknown type is returned as `Opaque`. A reply whose body does not fit its type is
    also `Opaque`, because many replies have no body, and REP-I0006 does not define the body of a
    FAILURE. Raises HeaderError if the header is invalid, and BodyError if the body of a topic or
    request is invalid.
    """
    comm_type, reply_code = check_header(frame)
    layout = LAYOUT_OF_TYPE.get(frame.msg_type)
    if comm_type is CommType.SERVICE_REPLY:
        layout = LAYOUT_OF_REPLY.get(frame.msg_type, layout)
    message: Message = Opaque(frame.msg_type, frame.body)
    real = Real.FLOAT32
    if layout is not None:
        try:
            message, real = layout.decode(frame.body, frame.byte_order)
        except BodyError:
            if comm_type is not CommType.SERVICE_REPLY:
                raise
    return Packet(message, comm_type, reply_code, Dialect(frame.byte_order, real))


_Header = tuple[int, CommType, ReplyCode, BodyReader]
"""Contents of a valid header. The first item is the frame's size including the prefix, bytes."""


class PacketFramer(Framer):
    """A framer that returns packets.

    A controller sends few different headers, so each different header is decoded only once.
    """

    def __init__(self, byte_order: ByteOrder | None = None, max_length: int = MAX_LENGTH) -> None:
        super().__init__(byte_order, max_length)
        self._headers: dict[tuple[bytes], _Header] = {}
        """Decoded headers of messages with fixed layouts, by the bytes of the header."""

    def next_packet(self) -> Packet | None:
        """Return the packet of the next frame, or None if the frame is incomplete.

        Raises FrameError if the length is invalid, and at every later call. Raises HeaderError if
        the header is invalid, and BodyError if the body of a topic or request is invalid. After
        these two errors, the next call continues with the following frame.
        """
        buffer, start = self._buffer, self._start
        received = len(buffer) - start
        if received < self._needed:
            return None
        if received < _WHOLE_HEADER:
            return self._unknown()
        header = self._headers.get(_HEADER_BYTES(buffer, start))
        if header is None or received < header[0]:
            return self._unknown()
        size, comm_type, reply_code, reader = header
        self._start = start + size
        self._needed = PREFIX_SIZE
        message = reader.read(buffer, start + _WHOLE_HEADER)
        return NEW(Packet, (message, comm_type, reply_code, reader.dialect))

    def _unknown(self) -> Packet | None:
        frame = self.next_frame()
        if frame is None:
            return None
        packet = decode(frame)
        layout = LAYOUT_OF_CLASS.get(type(packet.message))
        if isinstance(layout, FixedLayout):
            length = HEADER_SIZE + len(frame.body)
            words = struct.pack(f'{frame.byte_order.value}4i', length, *frame[:3])
            self._headers[(words,)] = (
                PREFIX_SIZE + length,
                packet.comm_type,
                packet.reply_code,
                layout.reader(len(frame.body), frame.byte_order),
            )
        return packet


_WHOLE_HEADER = PREFIX_SIZE + HEADER_SIZE
_HEADER_BYTES = struct.Struct(f'{_WHOLE_HEADER}s').unpack_from
"""Function that reads a header's bytes, faster than a slice of the buffer."""
