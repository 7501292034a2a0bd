# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motoman's MOTION_CTRL and MOTION_REPLY: bytes made with struct alone, and back."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples
from wire_examples import DIALECTS, FLOAT32, HEADERS, INT32, bits, frames_of

from epson_driver.simple_message import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    BodyError,
    Dialect,
    FieldError,
    Frame,
    MessageType,
    MotionCtrl,
    MotionReply,
    Packet,
    ReplyCode,
    decode,
    encode,
    reply,
    request,
)
from epson_driver.simple_message.motoman import Command, Invalid, NotReady, Result

DATA = (1.0, -2.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 8.0)
START_TRAJ_MODE = 200121
ORDERS = pytest.mark.parametrize(
    ('order', 'dialect'), [('<', LITTLE_ENDIAN), ('>', BIG_ENDIAN)], ids=['little', 'big']
)


@ORDERS
def test_motion_ctrl_is_64_bytes_long(order: str, dialect: Dialect) -> None:
    wire = struct.pack(order + '4i3i10f', 64, 2001, 2, 0, 0, 7, START_TRAJ_MODE, *DATA)
    assert len(wire) == 68
    message = MotionCtrl(0, 7, Command.START_TRAJ_MODE, DATA)
    assert encode(request(message), dialect) == wire
    (frame,) = frames_of(wire)
    assert decode(frame).message == message


@ORDERS
def test_motion_reply_is_72_bytes_long(order: str, dialect: Dialect) -> None:
    wire = struct.pack(order + '4i5i10f', 72, 2002, 3, 1, 1, 3, 14, 3, 3011, *DATA)
    assert len(wire) == 76
    message = MotionReply(1, 3, 14, Result.INVALID, Invalid.DATA_START_POS, DATA)
    assert encode(reply(message, ReplyCode.SUCCESS), dialect) == wire
    (frame,) = frames_of(wire)
    assert decode(frame).message == message


def test_the_first_bytes_as_they_are_in_a_capture() -> None:
    wire = encode(request(MotionCtrl(0, 0, Command.CHECK_MOTION_READY)), LITTLE_ENDIAN)
    assert wire == (
        bytes.fromhex('40000000 d1070000 02000000 00000000  00000000 00000000 a50d0300')
        + bytes(40)
    )


@pytest.mark.parametrize('dialect', DIALECTS, ids=str)
@settings(max_examples=examples(40))
@given(data=st.data())
def test_every_value_comes_back_bit_exact(dialect: Dialect, data: st.DataObject) -> None:
    ten = st.tuples(*[FLOAT32] * 10)
    message = data.draw(
        st.builds(MotionCtrl, INT32, INT32, INT32, ten)
        | st.builds(MotionReply, INT32, INT32, INT32, INT32, INT32, ten)
    )
    packet = Packet(message, *data.draw(HEADERS), dialect)
    (frame,) = frames_of(encode(packet, dialect))
    received = decode(frame)
    assert bits(received.message) == bits(message)
    assert received.dialect == dialect


@pytest.mark.parametrize(('msg_type', 'size'), [(2001, 52), (2002, 60)])
@pytest.mark.parametrize('off', [-4, -1, 1, 4])
def test_a_body_of_another_length_is_refused(msg_type: int, size: int, off: int) -> None:
    with pytest.raises(
        BodyError, match=f'body = .*{size + off} bytes.* has {size} or {size + 40}'
    ):
        decode(Frame(msg_type, 2, 0, bytes(size + off), LITTLE_ENDIAN.byte_order))


def test_a_number_that_does_not_fit_is_named() -> None:
    with pytest.raises(FieldError, match='command = 2147483648: must be an int32'):
        encode(request(MotionCtrl(0, 0, 2**31)), LITTLE_ENDIAN)
    with pytest.raises(FieldError, match=r'data = .*9 values.*: must have 10'):
        encode(request(MotionCtrl(0, 0, 0, (0.0,) * 9)), LITTLE_ENDIAN)


def test_the_numbers_of_the_protocol() -> None:
    assert (MessageType.MOTION_CTRL, MessageType.MOTION_REPLY) == (2001, 2002)
    assert [int(command) for command in Command] == [
        *(200101, 200102),
        *(200111, 200112, 200113, 200114),
        *(200121, 200122),
        200130,
    ]
    assert [int(result) for result in Result] == list(range(7))
    assert [int(code) for code in Invalid] == [*range(3000, 3007), *range(3010, 3018)]
    assert [int(code) for code in NotReady] == list(range(5000, 5013))
