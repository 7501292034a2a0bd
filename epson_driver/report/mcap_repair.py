# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Makes a readable MCAP file of one that breaks off: a full disk, a power cut, `kill -9`."""

from pathlib import Path

from epson_driver.inputs import open_file

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, DATA_END = 0x01, 0x02, 0x0F
"""Records of the MCAP specification, section Records."""

_LENGTH = 9
"""Bytes of a record's operation code and length."""

_END = bytes([FOOTER]) + (20).to_bytes(8, 'little') + bytes(20) + MAGIC
"""A footer that points at no summary: a reader scans the records then."""


def whole_mcap(path: Path, folder: Path) -> Path | None:
    """Return a copy, in a folder, of the whole records of a file.

    None if it is no MCAP file. Raises OSError.
    """
    copy = folder / path.name
    with open_file(path) as source:
        if source.read(len(MAGIC)) != MAGIC:
            return None
        size = path.stat().st_size
        with copy.open('wb') as target:
            target.write(MAGIC)
            while len(head := source.read(_LENGTH)) == _LENGTH:
                length = int.from_bytes(head[1:], 'little')
                if head[0] in (0, FOOTER, DATA_END) or source.tell() + length > size:
                    break
                target.write(head + source.read(length))
            target.write(_END)
    return copy
