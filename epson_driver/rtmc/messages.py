# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The messages of Real-time Motion Control, from bytes and to bytes.

Source: EPSON's open client library (rtmc-client-library 1.1.0). A message has an ID, a parameter
of two 16-bit words, and data. A reply has the request's ID. Its high word is 0 if the request is
refused, and the low word then gives the reason (`conditions.py`).
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from epson_driver.simple_message import Mode, Status, TriState

JOINTS = 6
"""Number of joint values in each message. With fewer joints, the last values are 0."""

BUFFER_SIZES = (2, 5, 10)
MAX_PASSWORD_BYTES = 32

MAX_MESSAGE_BYTES = 1024

_CDR_LITTLE_ENDIAN = bytes((0, 1, 0, 0))

_HEADER = struct.Struct('<4sHxxHHI')  # encapsulation, ID, low word, high word, length of the data


class Request(IntEnum):
    """Message IDs. The controller sends the two notices without a request."""

    STATUS_NOTICE = 0
    JOINTS_NOTICE = 1
    STATUS = 100
    JOINTS = 101
    FORMATS = 102
    MESSAGES = 103
    CONNECT = 1000
    CHECK_MODEL = 1001
    MODEL_CHECKED = 1002
    MODEL = 1003
    SET_SEND_FORMAT = 1004
    SEND_FORMAT = 1005
    SET_RECEIVE_FORMAT = 1006
    RECEIVE_FORMAT = 1007
    SET_MOTORS = 1008
    MOTORS = 1009
    SET_POWER = 1010
    POWER = 1011
    SET_MODE = 1012
    MODE = 1013
    MOVE = 1014
    JOINTS_AT_REST = 1015
    RESET = 1016
    SET_BUFFER = 1017
    BUFFER = 1018
    SET_OUTPUTS = 1019
    OUTPUTS = 1020
    INPUTS = 1021
    SET_WEIGHT = 1022
    WEIGHT = 1023
    SET_INERTIA = 1024
    INERTIA = 1025


STATUS_DATA = struct.Struct('<BBHHH24x')  # without the details of the error and the warning
JOINTS_DATA = struct.Struct(f'<{JOINTS}d')
FORMATS_DATA = struct.Struct('<BB')
TARGET_DATA = struct.Struct(f'<{JOINTS}dH')
MOVED_DATA = struct.Struct(f'<B7x{JOINTS}dI4x')
NUMBER_DATA = struct.Struct('<H')
WEIGHT_DATA = struct.Struct('<d')
ECCENTRIC_DATA = struct.Struct('<dH')
ECCENTRIC_REPLY_DATA = struct.Struct('<dH6x')

MAX_TEXT_BYTES = 200  # of an error text, which is shown in one line

REPLY_DATA: dict[int, struct.Struct] = {
    Request.STATUS_NOTICE: STATUS_DATA,
    Request.JOINTS_NOTICE: JOINTS_DATA,
    Request.STATUS: STATUS_DATA,
    Request.JOINTS: JOINTS_DATA,
    Request.FORMATS: FORMATS_DATA,
    Request.MOVE: MOVED_DATA,
    Request.JOINTS_AT_REST: JOINTS_DATA,
    Request.OUTPUTS: NUMBER_DATA,
    Request.INPUTS: NUMBER_DATA,
    Request.WEIGHT: WEIGHT_DATA,
}
"""Request → data of its successful reply, or of the notice.

EPSON's client disconnects if the data has another size.
"""


class RtmcError(Exception):
    """Bytes that are not a message. The text gives the reason."""


@dataclass(frozen=True, slots=True)
class RtmcMessage:
    """A request, a reply or a notice. `low` and `high` are the two words of its parameter."""

    number: int
    low: int = 0
    high: int = 0
    data: bytes = b'\0'

    def encode(self) -> bytes:
        """Return the message in XCDR1, little-endian."""
        size = len(self.data)
        return _HEADER.pack(_CDR_LITTLE_ENDIAN, self.number, self.low, self.high, size) + self.data

    def values(self, layout: struct.Struct) -> tuple[Any, ...]:
        """Return the values of the data. Raises RtmcError if the data has another size."""
        if len(self.data) != layout.size:
            name = f'message {self.number}: {len(self.data)} bytes of data'
            raise RtmcError(f'{name}: must be {layout.size}')
        return layout.unpack(self.data)


def decode(data: bytes) -> RtmcMessage:
    """Return the message in `data`. Raises RtmcError if it is not exactly one complete message."""
    if len(data) < _HEADER.size:
        raise RtmcError(f'{len(data)} bytes: a message has at least {_HEADER.size}')
    encapsulation, number, low, high, size = _HEADER.unpack_from(data)
    if encapsulation[:2] != _CDR_LITTLE_ENDIAN[:2]:  # the other two are options without a meaning
        raise RtmcError(f'encapsulation {encapsulation.hex()}: must be little-endian CDR (0001)')
    body = data[_HEADER.size :]
    # A writer may pad the end to a multiple of four bytes.
    if not size <= len(body) < size + 4:
        raise RtmcError(
            f'message {number}: {len(body)} bytes of data, but its header specifies {size}'
        )
    return RtmcMessage(number, low, high, body[:size])


def starts(data: bytes | bytearray) -> bool:
    """Return whether the bytes start with a message of this protocol."""
    known = tuple(_CDR_LITTLE_ENDIAN + struct.pack('<H', number) for number in Request)
    return data.startswith(known)


def split(data: bytearray) -> Iterator[RtmcMessage]:
    """Remove the complete messages from the start of a recorded connection, and yield them.

    Raises RtmcError if bytes are not a message.
    """
    while len(data) >= _HEADER.size:
        end = _HEADER.size + _HEADER.unpack_from(data)[-1]
        if end > MAX_MESSAGE_BYTES:
            raise RtmcError(f'a message of {end} bytes: must be at most {MAX_MESSAGE_BYTES}')
        if len(data) < end:
            return
        message = decode(bytes(data[:end]))
        del data[:end]
        yield message


class OperationMode(IntEnum):
    """Operation modes of the controller."""

    PROGRAM = 0
    AUTO = 1
    TEACH = 2


@dataclass(frozen=True, slots=True)
class RtmcStatus:
    """The status record. `error` and `warning` are the numbers of an error and a warning, or 0."""

    safeguard_open: bool
    estop: bool
    mode: OperationMode
    error: int = 0
    warning: int = 0

    def encode(self) -> bytes:
        flags = (self.safeguard_open, self.estop, self.mode)
        return STATUS_DATA.pack(*flags, self.error, self.warning)

    @classmethod
    def decode(cls, message: RtmcMessage) -> 'RtmcStatus':
        """Return the status in a message. Raises RtmcError if it is not valid."""
        safeguard, estop, mode, error, warning = message.values(STATUS_DATA)
        if mode not in tuple(OperationMode):
            raise RtmcError(f'status: operation mode {mode}: must be 0, 1 or 2')
        return cls(bool(safeguard), bool(estop), OperationMode(mode), error, warning)

    def simple_status(self, powered: bool | None, *, in_motion: bool) -> Status:
        """Return the status as a STATUS message of the simple message protocol.

        `powered`: whether the motors are on, or None if this is unknown.
        """
        auto = self.mode is OperationMode.AUTO
        motors = TriState.UNKNOWN if powered is None else TriState(powered)
        possible = auto and not (self.safeguard_open or self.estop or self.error)
        return Status(
            drives_powered=motors,
            e_stopped=TriState(self.estop),
            error_code=self.error,
            in_error=TriState(bool(self.error)),
            in_motion=TriState(in_motion),
            mode=Mode.AUTO if auto else Mode.MANUAL,
            motion_possible=motors if possible else TriState.FALSE,
        )


def decode_text(data: bytes) -> str:
    """Return the text of the error in a reply to MESSAGES, or '' if there is none."""
    start = NUMBER_DATA.size + int.from_bytes(data[: NUMBER_DATA.size], 'little')
    size = int.from_bytes(data[start : start + NUMBER_DATA.size], 'little')
    text = data[start + NUMBER_DATA.size :][: min(size, MAX_TEXT_BYTES)]
    return text.rstrip(b'\0').decode(errors='replace')


def encode_text(error: str) -> bytes:
    """Return the data of a reply to MESSAGES, without a warning. An empty text has no bytes."""
    encoded = error.encode() + b'\0' if error else b''
    return NUMBER_DATA.pack(0) + NUMBER_DATA.pack(len(encoded)) + encoded
