# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The bytes of the thesis's figures and of the real ROS 1 client, in both byte orders."""

import struct
from dataclasses import fields, is_dataclass

import pytest
from wire_examples import EXAMPLES, Example, frames_of

from epson_driver.simple_message import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    ByteOrder,
    Dialect,
    Framer,
    Packet,
    decode,
    encode,
)


def as_float32(value: object) -> object:
    """Return a message's fields with every float rounded to the float32 that is nearest."""
    if is_dataclass(value):
        return type(value), *(as_float32(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, tuple):
        return tuple(as_float32(item) for item in value)
    return struct.pack('<f', value) if isinstance(value, float) else value


@pytest.mark.parametrize('example', EXAMPLES, ids=lambda example: example.name)
@pytest.mark.parametrize('dialect', [LITTLE_ENDIAN, BIG_ENDIAN], ids=['little', 'big'])
def test_encode_gives_the_bytes_of_the_figure(example: Example, dialect: Dialect) -> None:
    expected = example.little if dialect == LITTLE_ENDIAN else example.big
    assert encode(example.packet, dialect) == expected


@pytest.mark.parametrize('example', EXAMPLES, ids=lambda example: example.name)
def test_decode_reads_the_figure_in_little_endian(example: Example) -> None:
    (frame,) = frames_of(example.little)
    assert frame.byte_order is ByteOrder.LITTLE
    assert contents(decode(frame)) == contents(example.packet)


@pytest.mark.parametrize('example', EXAMPLES, ids=lambda example: example.name)
def test_decode_reads_the_figure_in_big_endian(example: Example) -> None:
    (frame,) = frames_of(example.big)
    assert frame.byte_order is ByteOrder.BIG
    packet = decode(frame)
    assert contents(packet) == contents(example.packet)
    assert packet.dialect == BIG_ENDIAN


def contents(packet: Packet) -> tuple[object, ...]:
    return packet.msg_type, packet.comm_type, packet.reply_code, as_float32(packet.message)


def test_figure_4_holds_the_joint_values_that_the_thesis_prints() -> None:
    printed = [-3.6919e-05, -3.916e-06, -2.2920e-05, -8.7777e-05, -5.4792e-05, -8.6886e-05]
    message = decode(frames_of(EXAMPLES[0].little)[0]).message
    assert message.joints == pytest.approx(printed + [0.0] * 4, rel=1e-4, abs=0.0)


def test_figure_6_holds_the_joint_values_that_the_thesis_prints() -> None:
    printed = [-3.1e-15, 0.327742815, -0.865697324, -3.141592741, 0.705099046, -3.141592741]
    message = decode(frames_of(EXAMPLES[2].little)[0]).message
    assert message.joints[0] == pytest.approx(printed[0], rel=0.01)
    assert message.joints[1:] == pytest.approx(printed[1:] + [0.0] * 4, rel=1e-9, abs=0.0)
    assert (message.velocity, message.duration) == pytest.approx((0.1, 5.0), rel=1e-7)


def test_all_examples_as_one_stream_are_read_in_their_order() -> None:
    framer = Framer()
    framer.receive_data(b''.join(example.little for example in EXAMPLES))
    for example in EXAMPLES:
        frame = framer.next_frame()
        assert frame is not None
        assert contents(decode(frame)) == contents(example.packet)
    assert framer.next_frame() is None
