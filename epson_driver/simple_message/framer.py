# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Bytes to frames, in any segmentation.

One frame on the wire, every word an int32 in the controller's byte order:

    +--------+----------+-----------+------------+------------------------+
    | length | msg_type | comm_type | reply_code | body (length-12 bytes) |
    +--------+----------+-----------+------------+------------------------+

`length` counts what follows it. There is no magic number, no version and no checksum.

The byte order is detected from the first length: a length that makes sense in one order is at
least 2**16 in the other, so that exactly one order can be right.
"""

import struct
from typing import NamedTuple

from epson_driver.simple_message.constants import CommType, MessageType
from epson_driver.simple_message.dialect import ByteOrder
from epson_driver.simple_message.errors import FrameError

PREFIX_SIZE = 4
HEADER_SIZE = 12
MAX_LENGTH = 0xFFFF
"""Longest frame accepted. The longest standard message (JOINT_TRAJ, 200 points, float64) needs
20,016; staying below 2**16 keeps the detection of the byte order unambiguous."""

_PREFIX = {order: struct.Struct(order.value + 'i') for order in ByteOrder}
_HEADER = {order: struct.Struct(order.value + 'iii') for order in ByteOrder}


class Frame(NamedTuple):
    """One message as it came: the header's words, unchecked, and the body's bytes."""

    msg_type: int
    comm_type: int
    reply_code: int
    body: bytes
    byte_order: ByteOrder

    @property
    def heartbeat(self) -> bool:
        """Whether it is a heartbeat: a PING as a topic, which nobody answers."""
        return self.msg_type == MessageType.PING and self.comm_type == CommType.TOPIC


class Framer:
    """Collects bytes and gives out whole frames.

    `byte_order` None detects it from the first frame; `max_length` (≤ 65,535) bounds the memory
    that a peer can make this object hold to `max_length + 4` bytes plus the chunk given last.
    """

    def __init__(self, byte_order: ByteOrder | None = None, max_length: int = MAX_LENGTH) -> None:
        if not HEADER_SIZE <= max_length <= MAX_LENGTH:
            raise ValueError(f'max_length = {max_length}: must be {HEADER_SIZE} … {MAX_LENGTH}')
        self.byte_order = byte_order
        self._max_length = max_length
        self._buffer: bytes | bytearray = b''
        self._start = 0
        """Where in the buffer the first frame that was not given out begins."""
        self._needed = PREFIX_SIZE
        """Bytes from there on without which nothing can be given out."""
        self._bad_length: int | None = None

    @property
    def unread(self) -> bytes:
        """The bytes that were received and not given out as a frame."""
        return bytes(self._buffer[self._start :])

    def receive_data(self, data: bytes) -> None:
        """Append bytes from the stream. Nothing is parsed before `next_frame`.

        After a FrameError bytes are dropped: the memory stays bounded whatever the peer sends.
        """
        if self._bad_length is not None:
            return
        if self._start == len(self._buffer):  # as a rule: what comes are whole frames
            self._buffer = data if type(data) is bytes else bytes(data)
        elif self._start or not isinstance(self._buffer, bytearray):
            self._buffer = bytearray(memoryview(self._buffer)[self._start :])
            self._buffer += data
        else:
            self._buffer += data
        self._start = 0

    def next_frame(self) -> Frame | None:
        """Return the next whole frame, or None until more bytes have come.

        Raises FrameError for an impossible length, now and at every later call: what follows it
        cannot be told apart from anything else.
        """
        if self._bad_length is not None:
            raise self._error(self._bad_length)
        buffered = len(self._buffer) - self._start
        if buffered < self._needed:
            return None
        if self.byte_order is None:
            self.byte_order = self._detect()
        order = self.byte_order
        length = self._length(order)
        if not HEADER_SIZE <= length <= self._max_length:
            raise self._fail(length)
        if buffered < PREFIX_SIZE + length:
            self._needed = PREFIX_SIZE + length
            return None
        self._needed = PREFIX_SIZE
        start = self._start + PREFIX_SIZE
        self._start = start + length
        msg_type, comm_type, reply_code = _HEADER[order].unpack_from(self._buffer, start)
        body = bytes(self._buffer[start + HEADER_SIZE : self._start])
        return Frame(msg_type, comm_type, reply_code, body, order)

    def _length(self, order: ByteOrder) -> int:
        length: int = _PREFIX[order].unpack_from(self._buffer, self._start)[0]
        return length

    def _detect(self) -> ByteOrder:
        for order in ByteOrder:
            if HEADER_SIZE <= self._length(order) <= self._max_length:
                return order
        raise self._fail(self._length(ByteOrder.LITTLE))

    def _fail(self, length: int) -> FrameError:
        self._buffer = b''
        self._start = 0
        self._needed = 0
        self._bad_length = length
        return self._error(length)

    def _error(self, length: int) -> FrameError:
        # A new one each time: an error that is raised again grows its traceback for ever.
        rule = f'must be {HEADER_SIZE} … {self._max_length}; is the byte order right?'
        return FrameError('length', length, rule)
