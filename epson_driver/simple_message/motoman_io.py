# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motoman's I/O messages as values, as MotoROS 1.9 has them (port 50242), and their addresses.

A request and its reply have types of their own; a reply says nothing of what it answers, so one
request is on its way at a time. A bit is addressed as on the teach pendant: ten times its group
and its place in that, 0 to 7. Group 1 of the general inputs is 00010 to 00017.
"""

from dataclasses import dataclass
from enum import IntEnum

from epson_driver.simple_message.messages import Message

GROUP_BITS = 8

GENERAL_INPUTS = 1
GENERAL_OUTPUTS = 1001
"""The first group of each."""


class MotomanIoResult(IntEnum):
    """Values of `result` in the replies."""

    OK = 0
    READ_ADDRESS_INVALID = 1001
    WRITE_ADDRESS_INVALID = 1002
    WRITE_VALUE_INVALID = 1003
    READ_API_ERROR = 1004
    WRITE_API_ERROR = 1005


def bit_address(first_group: int, index: int) -> int:
    """Return the address of a bit, counted from 0 at the first bit of a group."""
    group, bit = divmod(index, GROUP_BITS)
    return (first_group + group) * 10 + bit


@dataclass(frozen=True, slots=True)
class ReadIoBit(Message):
    """READ_IO_BIT (2003)."""

    address: int


@dataclass(frozen=True, slots=True)
class ReadIoBitReply(Message):
    """READ_IO_BIT_REPLY (2004)."""

    value: int
    result: int


@dataclass(frozen=True, slots=True)
class WriteIoBit(Message):
    """WRITE_IO_BIT (2005)."""

    address: int
    value: int


@dataclass(frozen=True, slots=True)
class WriteIoBitReply(Message):
    """WRITE_IO_BIT_REPLY (2006)."""

    result: int


@dataclass(frozen=True, slots=True)
class ReadIoGroup(Message):
    """READ_IO_GROUP (2007): eight bits, whose address lacks its last digit."""

    address: int


@dataclass(frozen=True, slots=True)
class ReadIoGroupReply(Message):
    """READ_IO_GROUP_REPLY (2008): the lowest bit of `value` is the first one of the group."""

    value: int
    result: int


@dataclass(frozen=True, slots=True)
class WriteIoGroup(Message):
    """WRITE_IO_GROUP (2009)."""

    address: int
    value: int


@dataclass(frozen=True, slots=True)
class WriteIoGroupReply(Message):
    """WRITE_IO_GROUP_REPLY (2010)."""

    result: int


@dataclass(frozen=True, slots=True)
class IoCtrlReply(Message):
    """IOCTRL_REPLY (2011): the answer to what is none of these messages.

    `result` is a `motoman.Result`, `subcode` a `motoman.Invalid`.
    """

    result: int
    subcode: int
