# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Bytes to lines, in any segmentation."""

from epson_driver.inputs import printable
from epson_driver.simple_message import ByteOrder, FrameError

MAX_LINE_BYTES = 8192
"""A longer line is none: an answer has 4,060 characters and its command's name (RC+ 7.0)."""


class LineFramer:
    """Collects bytes and gives out lines, which end with CR, LF or both, without empty ones."""

    byte_order: ByteOrder | None = None

    def __init__(self) -> None:
        self._data = bytearray()

    @property
    def unread(self) -> bytes:
        """What has come of a line that is not complete."""
        return bytes(self._data)

    def receive_data(self, data: bytes) -> None:
        """Take bytes."""
        self._data += data.replace(b'\r', b'\n')

    def next_packet(self) -> str | None:
        """Return the next line, printable, or None. Raises FrameError for one that is too long."""
        while True:
            line, end, rest = self._data.partition(b'\n')
            if len(line) > MAX_LINE_BYTES:
                self._data.clear()
                rule = f'a line has at most {MAX_LINE_BYTES} bytes'
                raise FrameError('line', f'{len(line)} bytes', rule)
            if not end:
                return None
            self._data = rest
            if line:
                return printable(line.decode(errors='replace').strip())
