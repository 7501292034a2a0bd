# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The I/O messages of the draft "Generic Robot IO", used on port 11003.

docs/io.md specifies the bytes. A request and its reply have separate classes, because their bodies
differ. `message_id` is chosen by the client and copied into the reply. `timestamp` is the
controller's clock in ms.
"""

from dataclasses import dataclass
from enum import IntEnum, IntFlag

from epson_driver.simple_message.messages import Message


class IoType(IntEnum):
    """Type of an I/O point. A point's address is its type and its index, counted from 0."""

    DIGITAL_INPUT = 1
    DIGITAL_OUTPUT = 2
    ANALOG_INPUT = 3
    ANALOG_OUTPUT = 4
    GROUP_INPUT = 5
    GROUP_OUTPUT = 6
    FLAG = 7


class IoResult(IntEnum):
    """Result of one item of a request. TOO_MUCH is defined by this package, not by the draft."""

    SUCCESS = 1
    TYPE_UNSUPPORTED = 1001
    TYPE_FEATURE_UNSUPPORTED = 1002
    INDEX_FEATURE_UNSUPPORTED = 1003
    INDEX_OUT_OF_RANGE = 2001
    VALUE_OUT_OF_RANGE = 2002
    NO_SUBSCRIPTION = 2003
    TOO_MUCH = 65001


class ControllerFeature(IntFlag):
    TIMESTAMPS = 1


class IoFeature(IntFlag):
    RESET = 1
    STREAMING = 2


ALL = -1
"""Index in an `IoReset` item that stands for all points of the type. If the type is ALL, too, the
item stands for all outputs and flags."""


@dataclass(frozen=True, slots=True)
class IoAddress:
    """The address of a point, or of the first point of a range."""

    io_type: int
    index: int


@dataclass(frozen=True, slots=True)
class IoSpan:
    io_type: int
    start: int
    count: int


@dataclass(frozen=True, slots=True)
class IoRange:
    io_type: int
    start: int
    count: int
    features: int


@dataclass(frozen=True, slots=True)
class IoSetting:
    io_type: int
    index: int
    value: int


@dataclass(frozen=True, slots=True)
class IoOutcome:
    """A point, or the first point of a range, and the `IoResult` of the request for it."""

    io_type: int
    index: int
    result: int


@dataclass(frozen=True, slots=True)
class IoReading:
    """A point, the `IoResult` of reading it, and its value. The value is 0 after a failure."""

    io_type: int
    index: int
    result: int
    value: int


@dataclass(frozen=True, slots=True)
class IoValues:
    io_type: int
    start: int
    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class IoInfo(Message):
    """IO_INFO (65200), the request for the ranges of points that the controller has."""

    message_id: int = 0


@dataclass(frozen=True, slots=True)
class IoInfoReply(Message):
    """The reply to IO_INFO. `features` are `ControllerFeature` bits."""

    message_id: int = 0
    features: int = 0
    items: tuple[IoRange, ...] = ()


@dataclass(frozen=True, slots=True)
class IoRead(Message):
    """IO_READ (65201), the request to read points."""

    message_id: int = 0
    items: tuple[IoAddress, ...] = ()


@dataclass(frozen=True, slots=True)
class IoReadReply(Message):
    """The reply to IO_READ, with one reading per item of the request, in the same order."""

    message_id: int = 0
    timestamp: int = 0
    items: tuple[IoReading, ...] = ()


@dataclass(frozen=True, slots=True)
class IoWrite(Message):
    """IO_WRITE (65202), the request to set outputs and flags."""

    message_id: int = 0
    items: tuple[IoSetting, ...] = ()


@dataclass(frozen=True, slots=True)
class IoWriteReply(Message):
    """The reply to IO_WRITE, with one outcome per item of the request, in the same order."""

    message_id: int = 0
    timestamp: int = 0
    items: tuple[IoOutcome, ...] = ()


@dataclass(frozen=True, slots=True)
class IoReset(Message):
    """IO_RESET (65203), the request to set points to their safe values (see `ALL`)."""

    message_id: int = 0
    items: tuple[IoAddress, ...] = ()


@dataclass(frozen=True, slots=True)
class IoResetReply(Message):
    message_id: int = 0
    items: tuple[IoOutcome, ...] = ()


@dataclass(frozen=True, slots=True)
class IoSubscribe(Message):
    """IO_STREAM_SUB (65204), the request to publish ranges of points."""

    message_id: int = 0
    items: tuple[IoSpan, ...] = ()


@dataclass(frozen=True, slots=True)
class IoSubscribeReply(Message):
    message_id: int = 0
    items: tuple[IoOutcome, ...] = ()


@dataclass(frozen=True, slots=True)
class IoUnsubscribe(Message):
    """IO_STREAM_UNSUB (65205), with the first points of the ranges to stop publishing."""

    message_id: int = 0
    items: tuple[IoAddress, ...] = ()


@dataclass(frozen=True, slots=True)
class IoUnsubscribeReply(Message):
    message_id: int = 0
    items: tuple[IoOutcome, ...] = ()


@dataclass(frozen=True, slots=True)
class IoPublish(Message):
    """IO_STREAM_PUB (65206), a topic with the values of all subscribed ranges."""

    timestamp: int = 0
    items: tuple[IoValues, ...] = ()
