# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The I/O messages (port 11003) as values: the draft "Generic Robot IO" in its deployed form.

docs/io.md specifies the bytes. Every field is an int32. A list of items is sent as its length and
the items. A request and its reply have separate classes, because their bodies differ. `message_id`
is chosen by the client and copied into the reply. `timestamp` is the controller's clock in ms.
"""

from dataclasses import dataclass
from enum import IntEnum, IntFlag

from epson_driver.simple_message.messages import Message


class IoType(IntEnum):
    """Type of a point: the first part of its address, followed by the index, from 0."""

    DIGITAL_INPUT = 1
    DIGITAL_OUTPUT = 2
    ANALOG_INPUT = 3
    ANALOG_OUTPUT = 4
    GROUP_INPUT = 5
    GROUP_OUTPUT = 6
    FLAG = 7


class IoResult(IntEnum):
    """Result of one item. TOO_MUCH is specific to this package, from the draft's free range."""

    SUCCESS = 1
    TYPE_UNSUPPORTED = 1001
    TYPE_FEATURE_UNSUPPORTED = 1002
    INDEX_FEATURE_UNSUPPORTED = 1003
    INDEX_OUT_OF_RANGE = 2001
    VALUE_OUT_OF_RANGE = 2002
    NO_SUBSCRIPTION = 2003
    TOO_MUCH = 65001


class ControllerFeature(IntFlag):
    """Bits of `IoInfoReply.features`."""

    TIMESTAMPS = 1


class IoFeature(IntFlag):
    """Bits of `IoRange.features`."""

    RESET = 1
    STREAMING = 2


ALL = -1
"""As the index of an `IoReset` item: the whole type. As type and index: every output and flag."""


@dataclass(frozen=True, slots=True)
class IoAddress:
    """One point, or the start of a subscribed range."""

    io_type: int
    index: int


@dataclass(frozen=True, slots=True)
class IoSpan:
    """`count` points of one type, starting at `start`."""

    io_type: int
    start: int
    count: int


@dataclass(frozen=True, slots=True)
class IoRange:
    """A range of points of the controller, and its operations (`IoFeature` bits)."""

    io_type: int
    start: int
    count: int
    features: int


@dataclass(frozen=True, slots=True)
class IoSetting:
    """A point and its requested value."""

    io_type: int
    index: int
    value: int


@dataclass(frozen=True, slots=True)
class IoOutcome:
    """A point (or the start of a range) and the `IoResult` of its request."""

    io_type: int
    index: int
    result: int


@dataclass(frozen=True, slots=True)
class IoReading:
    """A point, the `IoResult` of reading it, and its value (0 if it could not be read)."""

    io_type: int
    index: int
    result: int
    value: int


@dataclass(frozen=True, slots=True)
class IoValues:
    """The values of a subscribed range."""

    io_type: int
    start: int
    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class IoInfo(Message):
    """IO_INFO (65200), the request for the list of existing points."""

    message_id: int = 0


@dataclass(frozen=True, slots=True)
class IoInfoReply(Message):
    """IO_INFO, the reply. `features` are `ControllerFeature` bits."""

    message_id: int = 0
    features: int = 0
    items: tuple[IoRange, ...] = ()


@dataclass(frozen=True, slots=True)
class IoRead(Message):
    """IO_READ (65201), the request."""

    message_id: int = 0
    items: tuple[IoAddress, ...] = ()


@dataclass(frozen=True, slots=True)
class IoReadReply(Message):
    """IO_READ, the reply: one reading per item of the request, in the same order."""

    message_id: int = 0
    timestamp: int = 0
    items: tuple[IoReading, ...] = ()


@dataclass(frozen=True, slots=True)
class IoWrite(Message):
    """IO_WRITE (65202), the request."""

    message_id: int = 0
    items: tuple[IoSetting, ...] = ()


@dataclass(frozen=True, slots=True)
class IoWriteReply(Message):
    """IO_WRITE, the reply: one outcome per item of the request, in the same order."""

    message_id: int = 0
    timestamp: int = 0
    items: tuple[IoOutcome, ...] = ()


@dataclass(frozen=True, slots=True)
class IoReset(Message):
    """IO_RESET (65203), the request to set safe values. `ALL` may be an index or a type."""

    message_id: int = 0
    items: tuple[IoAddress, ...] = ()


@dataclass(frozen=True, slots=True)
class IoResetReply(Message):
    """IO_RESET, the reply."""

    message_id: int = 0
    items: tuple[IoOutcome, ...] = ()


@dataclass(frozen=True, slots=True)
class IoSubscribe(Message):
    """IO_STREAM_SUB (65204), the request: publish these ranges."""

    message_id: int = 0
    items: tuple[IoSpan, ...] = ()


@dataclass(frozen=True, slots=True)
class IoSubscribeReply(Message):
    """IO_STREAM_SUB, the reply."""

    message_id: int = 0
    items: tuple[IoOutcome, ...] = ()


@dataclass(frozen=True, slots=True)
class IoUnsubscribe(Message):
    """IO_STREAM_UNSUB (65205), the request to stop publishing the ranges with these starts."""

    message_id: int = 0
    items: tuple[IoAddress, ...] = ()


@dataclass(frozen=True, slots=True)
class IoUnsubscribeReply(Message):
    """IO_STREAM_UNSUB, the reply."""

    message_id: int = 0
    items: tuple[IoOutcome, ...] = ()


@dataclass(frozen=True, slots=True)
class IoPublish(Message):
    """IO_STREAM_PUB (65206), a topic with the values of all ranges the client has subscribed."""

    timestamp: int = 0
    items: tuple[IoValues, ...] = ()
