# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Splits received bytes into frames, regardless of how the network has split them.

A frame consists of int32 words in the controller's byte order, and a body:

    +--------+----------+-----------+------------+------------------------+
    | length | msg_type | comm_type | reply_code | body (length-12 bytes) |
    +--------+----------+-----------+------------+------------------------+

`length` is the number of bytes after this word. Frames have no magic number, version or checksum.

The byte order is detected from the first length. A length that is valid in one order is at least
2**16 in the other order, so at most one order is possible.
"""

import struct
from typing import NamedTuple

from epson_driver.simple_message.constants import ByteOrder, CommType, FrameError, MessageType

PREFIX_SIZE = 4
HEADER_SIZE = 12
MAX_LENGTH = 0xFFFF
"""Maximum of the field `length`. The longest standard message (JOINT_TRAJ, 200 points, float64)
needs 20,016. Below 2**16 the detection of the byte order is unambiguous."""

_PREFIX = {order: struct.Struct(order.value + 'i') for order in ByteOrder}
_HEADER = {order: struct.Struct(order.value + 'iii') for order in ByteOrder}


class Frame(NamedTuple):
    """One received message, with unchecked header words."""

    msg_type: int
    comm_type: int
    reply_code: int
    body: bytes
    byte_order: ByteOrder

    @property
    def heartbeat(self) -> bool:
        """Whether the frame is a heartbeat: a PING sent as a topic, which has no reply."""
        return self.msg_type == MessageType.PING and self.comm_type == CommType.TOPIC


class Framer:
    """Splits a stream of bytes into frames.

    `byte_order`: None to detect the byte order from the first frame. `max_length`: maximum of
    `length`, ≤ 65,535. At most `max_length + 4` bytes, and the last received chunk, are stored.
    """

    def __init__(self, byte_order: ByteOrder | None = None, max_length: int = MAX_LENGTH) -> None:
        if not HEADER_SIZE <= max_length <= MAX_LENGTH:
            raise ValueError(f'max_length = {max_length}: must be {HEADER_SIZE} … {MAX_LENGTH}')
        self.byte_order = byte_order
        self._max_length = max_length
        self._buffer: bytes | bytearray = b''
        self._start = 0
        self._needed = PREFIX_SIZE
        """Minimum size of the next frame, including its prefix, as far as known, bytes."""
        self._bad_length: int | None = None

    @property
    def unread(self) -> bytes:
        return bytes(self._buffer[self._start :])

    def receive_data(self, data: bytes) -> None:
        """Append received bytes, or drop them after a FrameError."""
        if self._bad_length is not None:
            return
        if self._start == len(self._buffer):  # the usual case: only complete frames arrive
            self._buffer = data if type(data) is bytes else bytes(data)
        elif self._start or not isinstance(self._buffer, bytearray):
            self._buffer = bytearray(memoryview(self._buffer)[self._start :])
            self._buffer += data
        else:
            self._buffer += data
        self._start = 0

    def next_frame(self) -> Frame | None:
        """Return the next frame, or None if it is incomplete.

        Raises FrameError if the length is invalid. Every later call raises FrameError, too,
        because the start of the next frame is unknown.
        """
        if self._bad_length is not None:
            raise self._fail(self._bad_length)
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
        # a new object each time, because an object's traceback grows each time it is raised
        rule = f'must be {HEADER_SIZE} … {self._max_length}; is the byte order right?'
        return FrameError('length', length, rule)
