# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motoman's protocol, as in MotoROS 1.9: values of its motion messages, and its I/O messages."""

from dataclasses import dataclass
from enum import IntEnum

from epson_driver.simple_message.messages import Message


class Command(IntEnum):
    CHECK_MOTION_READY = 200101
    CHECK_QUEUE_CNT = 200102
    STOP_MOTION = 200111
    START_SERVOS = 200112
    STOP_SERVOS = 200113
    RESET_ALARM = 200114
    START_TRAJ_MODE = 200121
    STOP_TRAJ_MODE = 200122
    DISCONNECT = 200130


class Result(IntEnum):
    """Values of `MotionReply.result`. In reply to a query, SUCCESS means true, FAILURE false."""

    SUCCESS = 0
    BUSY = 1
    FAILURE = 2
    INVALID = 3
    ALARM = 4
    NOT_READY = 5
    MP_FAILURE = 6


class Invalid(IntEnum):
    """Values of `MotionReply.subcode` if `result` is INVALID: the invalid part of the request."""

    UNSPECIFIED = 3000
    MSGSIZE = 3001
    MSGHEADER = 3002
    MSGTYPE = 3003
    GROUPNO = 3004
    SEQUENCE = 3005
    COMMAND = 3006
    DATA = 3010
    DATA_START_POS = 3011
    DATA_POSITION = 3012
    DATA_SPEED = 3013
    DATA_ACCEL = 3014
    DATA_INSUFFICIENT = 3015
    DATA_TIME = 3016
    DATA_TOOLNO = 3017


class NotReady(IntEnum):
    """Values of `MotionReply.subcode` if `result` is NOT_READY, or CHECK_MOTION_READY failed."""

    UNSPECIFIED = 5000
    ALARM = 5001
    ERROR = 5002
    ESTOP = 5003
    NOT_PLAY = 5004
    NOT_REMOTE = 5005
    SERVO_OFF = 5006
    HOLD = 5007
    NOT_STARTED = 5008
    WAITING_ROS = 5009
    SKILLSEND = 5010
    PFL_ACTIVE = 5011
    INC_MOVE_ERROR = 5012


GROUP_BITS = 8

GENERAL_INPUTS = 1
"""Number of the first input group."""
GENERAL_OUTPUTS = 1001
"""Number of the first output group."""


class MotomanIoResult(IntEnum):
    """Values of `result` in the replies to READ_IO_… and WRITE_IO_…."""

    OK = 0
    READ_ADDRESS_INVALID = 1001
    WRITE_ADDRESS_INVALID = 1002
    WRITE_VALUE_INVALID = 1003
    READ_API_ERROR = 1004
    WRITE_API_ERROR = 1005


def bit_address(first_group: int, index: int) -> int:
    """Return the address of an I/O bit. `index`: 0 for the first bit of `first_group`."""
    group, bit = divmod(index, GROUP_BITS)
    return (first_group + group) * 10 + bit


@dataclass(frozen=True, slots=True)
class ReadIoBit(Message):
    """READ_IO_BIT (2003), the request to read the bit at `address` (see `bit_address`)."""

    address: int


@dataclass(frozen=True, slots=True)
class ReadIoBitReply(Message):
    value: int
    result: int


@dataclass(frozen=True, slots=True)
class WriteIoBit(Message):
    """WRITE_IO_BIT (2005), the request to set the bit at `address`."""

    address: int
    value: int


@dataclass(frozen=True, slots=True)
class WriteIoBitReply(Message):
    result: int


@dataclass(frozen=True, slots=True)
class ReadIoGroup(Message):
    """READ_IO_GROUP (2007), the request to read eight bits. `address` is the group's number."""

    address: int


@dataclass(frozen=True, slots=True)
class ReadIoGroupReply(Message):
    """READ_IO_GROUP_REPLY (2008). The lowest bit of `value` is the group's first bit."""

    value: int
    result: int


@dataclass(frozen=True, slots=True)
class WriteIoGroup(Message):
    """WRITE_IO_GROUP (2009), the request to set eight bits. `address` is the group's number."""

    address: int
    value: int


@dataclass(frozen=True, slots=True)
class WriteIoGroupReply(Message):
    result: int


@dataclass(frozen=True, slots=True)
class IoCtrlReply(Message):
    """IOCTRL_REPLY (2011), the reply to an unknown I/O message: a `Result` and an `Invalid`."""

    result: int
    subcode: int
