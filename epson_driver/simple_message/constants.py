# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers, number formats and errors of the protocol (ids: REP-I0004, structures: REP-I0006)."""

from dataclasses import dataclass, field
from enum import Enum, IntEnum, IntFlag

MAX_JOINTS = 10
"""Number of values in a message's joint data. Values beyond the arm's joints are 0.0."""


class MessageType(IntEnum):
    """Message ids with a known layout. Messages with other ids are `Opaque`."""

    PING = 1
    GET_VERSION = 2
    JOINT_POSITION = 10
    JOINT_TRAJ_PT = 11
    JOINT_TRAJ = 12
    STATUS = 13
    JOINT_TRAJ_PT_FULL = 14
    JOINT_FEEDBACK = 15
    MOTION_CTRL = 2001
    MOTION_REPLY = 2002
    READ_IO_BIT = 2003
    READ_IO_BIT_REPLY = 2004
    WRITE_IO_BIT = 2005
    WRITE_IO_BIT_REPLY = 2006
    READ_IO_GROUP = 2007
    READ_IO_GROUP_REPLY = 2008
    WRITE_IO_GROUP = 2009
    WRITE_IO_GROUP_REPLY = 2010
    IOCTRL_REPLY = 2011
    IO_INFO = 65200
    IO_READ = 65201
    IO_WRITE = 65202
    IO_RESET = 65203
    IO_STREAM_SUB = 65204
    IO_STREAM_UNSUB = 65205
    IO_STREAM_PUB = 65206


class CommType(IntEnum):
    INVALID = 0
    TOPIC = 1
    SERVICE_REQUEST = 2
    SERVICE_REPLY = 3


class ReplyCode(IntEnum):
    """Values of the third header word. Topics and requests have INVALID."""

    INVALID = 0
    SUCCESS = 1
    FAILURE = 2


class SpecialSequence(IntEnum):
    """Negative sequence numbers with a special meaning. Other negative numbers are reserved."""

    START_TRAJECTORY_DOWNLOAD = -1
    START_TRAJECTORY_STREAMING = -2
    END_TRAJECTORY = -3
    STOP_TRAJECTORY = -4


class TriState(IntEnum):
    UNKNOWN = -1
    FALSE = 0
    TRUE = 1


class Mode(IntEnum):
    """Values of `Status.mode`. The value 0 is not defined."""

    UNKNOWN = -1
    MANUAL = 1
    AUTO = 2


class ValidFields(IntFlag):
    """Bits of `valid_fields` in JOINT_TRAJ_PT_FULL and JOINT_FEEDBACK."""

    TIME = 1
    POSITION = 2
    VELOCITY = 4
    ACCELERATION = 8


class ByteOrder(Enum):
    LITTLE = '<'
    BIG = '>'


class Real(Enum):
    FLOAT32 = 'f'
    FLOAT64 = 'd'


@dataclass(frozen=True, slots=True)
class Dialect:
    """Byte order and real width of one controller. The defaults apply to EPSON's RC620 (x86)."""

    byte_order: ByteOrder = ByteOrder.LITTLE
    real: Real = Real.FLOAT32
    number: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        number = 2 * (self.byte_order is ByteOrder.BIG) + (self.real is Real.FLOAT64)
        object.__setattr__(self, 'number', number)

    def __str__(self) -> str:
        return f'{self.byte_order.name.lower()} endian with {self.real.name.lower()}'


LITTLE_ENDIAN = Dialect()
BIG_ENDIAN = Dialect(ByteOrder.BIG)

DIALECTS = tuple(Dialect(order, real) for order in ByteOrder for real in Real)
"""All dialects, by their `number`."""


class SimpleMessageError(ValueError):
    """An invalid value of a field of a frame or message, such as `length` or `joints[3]`."""

    def __init__(self, field: str, value: object, rule: str) -> None:
        super().__init__(f'{field} = {value!r}: {rule}')
        self.field = field
        self.value = value
        self.rule = rule


class FrameError(SimpleMessageError):
    """An invalid length prefix. The start of the next frame is unknown."""


class HeaderError(SimpleMessageError):
    """Header words that violate REP-I0006. Later frames can still be read."""


class BodyError(SimpleMessageError):
    """A body that does not fit its message type. Later frames can still be read."""


class FieldError(SimpleMessageError):
    """A value that cannot be encoded: too many or too few items, or a number out of range."""
