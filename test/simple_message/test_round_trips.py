# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Round trips of messages, and their bytes in published figures."""

import struct
from dataclasses import dataclass, fields, is_dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples
from wire_examples import (
    DIALECTS,
    EXAMPLES,
    FLOAT32,
    INT32,
    ZEROS,
    Example,
    bits,
    frames_of,
    packets,
)

from epson_driver.simple_message import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    ByteOrder,
    Dialect,
    Frame,
    Framer,
    GetVersion,
    JointFeedback,
    JointPosition,
    JointTraj,
    Message,
    Opaque,
    Packet,
    Ping,
    Real,
    Status,
    decode,
    encode,
    topic,
)
from epson_driver.simple_message.layouts import LAYOUT_OF_CLASS, LAYOUT_OF_TYPE, FixedLayout

WITHOUT_REALS = (Ping, GetVersion, Status, Opaque)


@pytest.mark.invariant(8)
@pytest.mark.parametrize('dialect', DIALECTS, ids=str)
@settings(max_examples=examples(60))
@given(data=st.data())
def test_inv8_every_message_round_trip_is_bit_exact(dialect: Dialect, data: st.DataObject) -> None:
    sent: Packet = data.draw(packets(dialect))
    (frame,) = frames_of(encode(sent, dialect))
    received = decode(frame)
    assert bits(received.message) == bits(sent.message)
    assert (received.comm_type, received.reply_code) == (sent.comm_type, sent.reply_code)
    assert received.msg_type == sent.msg_type
    assert received.dialect.byte_order is dialect.byte_order
    if not isinstance(sent.message, WITHOUT_REALS) and sent.message != JointTraj():
        assert received.dialect == dialect


@pytest.mark.invariant(8)
@pytest.mark.parametrize('order', ByteOrder, ids=lambda order: order.name)
@settings(max_examples=examples(50))
@given(words=st.lists(FLOAT32, min_size=31, max_size=31))
def test_inv8_measured_values_have_the_same_bits_order_and_sign(
    order: ByteOrder, words: list[float]
) -> None:
    body = struct.pack(f'{order.value}ii31f', 1, 15, *words)
    packet = decode(Frame(15, 1, 0, body, order))
    message = packet.message
    assert isinstance(message, JointFeedback)
    measured = (message.time, *message.positions, *message.velocities, *message.accelerations)
    assert bits(measured) == bits(tuple(words))
    assert encode(packet, packet.dialect)[16:] == body


def test_real_is_rounded_to_the_nearest_float32() -> None:
    wire = encode(topic(JointPosition(0, (0.1, *ZEROS[1:]))), LITTLE_ENDIAN)
    received = decode(frames_of(wire)[0]).message.joints[0]
    assert received == 0.100000001490116119384765625
    wire = encode(topic(JointPosition(0, (0.1, *ZEROS[1:]))), Dialect(real=Real.FLOAT64))
    assert decode(frames_of(wire)[0]).message.joints[0] == 0.1


@dataclass(frozen=True, slots=True)
class EpsonInputs(Message):
    """A vendor's message that a user adds, in EPSON's range of ids."""

    bank: int
    gain: float = 0.0
    bits: tuple[int, ...] = ()


@pytest.fixture
def _epson_inputs(monkeypatch: pytest.MonkeyPatch) -> None:
    row = FixedLayout(1500, EpsonInputs, 'bank:i gain:r bits:0|2i')
    monkeypatch.setitem(LAYOUT_OF_TYPE, row.msg_type, row)
    monkeypatch.setitem(LAYOUT_OF_CLASS, row.message_class, row)


@pytest.mark.usefixtures('_epson_inputs')
@pytest.mark.parametrize('dialect', DIALECTS, ids=str)
def test_vendor_message_needs_one_class_and_one_row(dialect: Dialect) -> None:
    @settings(max_examples=examples(20))
    @given(bank=INT32, gain=FLOAT32, held=st.just(()) | st.tuples(INT32, INT32))
    def round_trip(bank: int, gain: float, held: tuple[int, ...]) -> None:
        message = EpsonInputs(bank, gain, held)
        received = decode(frames_of(encode(topic(message), dialect))[0])
        assert bits(received.message) == bits(message)
        assert received.msg_type == 1500

    round_trip()


def as_float32(value: object) -> object:
    """Return a message's fields with every float rounded to the nearest float32."""
    if is_dataclass(value):
        return type(value), *(as_float32(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, tuple):
        return tuple(as_float32(item) for item in value)
    return struct.pack('<f', value) if isinstance(value, float) else value


@pytest.mark.parametrize('example', EXAMPLES, ids=lambda example: example.name)
@pytest.mark.parametrize('dialect', [LITTLE_ENDIAN, BIG_ENDIAN], ids=['little', 'big'])
def test_encoded_example_has_the_bytes_of_its_figure(example: Example, dialect: Dialect) -> None:
    expected = example.little if dialect == LITTLE_ENDIAN else example.big
    assert encode(example.packet, dialect) == expected


@pytest.mark.parametrize('example', EXAMPLES, ids=lambda example: example.name)
def test_figure_is_decoded_in_big_endian(example: Example) -> None:
    (frame,) = frames_of(example.big)
    assert frame.byte_order is ByteOrder.BIG
    packet = decode(frame)
    assert contents(packet) == contents(example.packet)
    assert packet.dialect == BIG_ENDIAN


def contents(packet: Packet) -> tuple[object, ...]:
    return packet.msg_type, packet.comm_type, packet.reply_code, as_float32(packet.message)


def test_stream_of_all_examples_is_decoded_in_order() -> None:
    framer = Framer()
    framer.receive_data(b''.join(example.little for example in EXAMPLES))
    for example in EXAMPLES:
        frame = framer.next_frame()
        assert frame is not None
        assert contents(decode(frame)) == contents(example.packet)
    assert framer.next_frame() is None
