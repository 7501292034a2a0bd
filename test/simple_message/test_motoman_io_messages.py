# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motoman's I/O messages: bytes made with struct alone, as MotoROS' source has them, and back."""

import struct

import pytest
from wire_examples import DIALECTS, frames_of

from epson_driver.simple_message import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    IoCtrlReply,
    MotomanIoResult,
    ReadIoBit,
    ReadIoBitReply,
    ReadIoGroup,
    ReadIoGroupReply,
    ReplyCode,
    WriteIoBit,
    WriteIoBitReply,
    WriteIoGroup,
    WriteIoGroupReply,
    decode,
    encode,
    reply,
    request,
)
from epson_driver.simple_message.motoman_io import GENERAL_INPUTS, GENERAL_OUTPUTS, bit_address

MESSAGES = [
    (2003, request(ReadIoBit(10010)), (10010,)),
    (2004, reply(ReadIoBitReply(1, 0), ReplyCode.SUCCESS), (1, 0)),
    (2005, request(WriteIoBit(10010, 1)), (10010, 1)),
    (2006, reply(WriteIoBitReply(1002), ReplyCode.FAILURE), (1002,)),
    (2007, request(ReadIoGroup(1001)), (1001,)),
    (2008, reply(ReadIoGroupReply(255, 0), ReplyCode.SUCCESS), (255, 0)),
    (2009, request(WriteIoGroup(1001, 129)), (1001, 129)),
    (2010, reply(WriteIoGroupReply(1003), ReplyCode.FAILURE), (1003,)),
    (2011, reply(IoCtrlReply(3, 3003), ReplyCode.SUCCESS), (3, 3003)),
]


@pytest.mark.parametrize(('msg_type', 'packet', 'words'), MESSAGES, ids=[m[0] for m in MESSAGES])
@pytest.mark.parametrize(
    ('order', 'dialect'), [('<', LITTLE_ENDIAN), ('>', BIG_ENDIAN)], ids=['little', 'big']
)
def test_each_message_has_the_bytes_of_motoros(msg_type, packet, words, order, dialect):
    header = (12 + 4 * len(words), msg_type, packet.comm_type, packet.reply_code)
    wire = struct.pack(f'{order}{4 + len(words)}i', *header, *words)
    assert encode(packet, dialect) == wire
    (frame,) = frames_of(wire)
    assert decode(frame).message == packet.message
    assert dialect in DIALECTS


def test_bits_are_addressed_by_group_and_place_as_on_the_teach_pendant():
    assert [bit_address(GENERAL_INPUTS, index) for index in (0, 7, 8)] == [10, 17, 20]
    assert [bit_address(GENERAL_OUTPUTS, index) for index in (0, 15)] == [10010, 10027]


def test_results_are_those_of_motoros():
    assert [int(result) for result in MotomanIoResult] == [0, 1001, 1002, 1003, 1004, 1005]
