# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Round trips of messages, and their bytes in published figures."""

import struct
from dataclasses import FrozenInstanceError, dataclass, fields, is_dataclass

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
    BodyError,
    ByteOrder,
    Dialect,
    FieldError,
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
    request,
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


@pytest.mark.parametrize('dialect', DIALECTS, ids=str)
@settings(max_examples=examples(20))
@given(data=st.data())
def test_received_message_equals_a_constructed_one(dialect: Dialect, data: st.DataObject) -> None:
    """It has the same class and repr, and it is immutable."""
    sent: Message = data.draw(packets(dialect)).message
    received = decode(frames_of(encode(topic(sent), dialect))[0]).message
    assert type(received) is type(sent)
    assert repr(received) == repr(sent)
    for field in fields(received):  # type: ignore[arg-type]
        with pytest.raises(FrozenInstanceError):
            setattr(received, field.name, 0)
        with pytest.raises(FrozenInstanceError):
            delattr(received, field.name)


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


@pytest.mark.usefixtures('_epson_inputs')
def test_vendor_message_has_the_errors_of_other_messages() -> None:
    with pytest.raises(BodyError) as too_long:
        decode(Frame(1500, 1, 0, bytes(9), ByteOrder.LITTLE))
    assert str(too_long.value) == (
        "body = '9 bytes': EpsonInputs (msg_type 1500) has 8 or 12 or 16 or 20"
    )
    with pytest.raises(FieldError, match=r"^bits = '3 values': must have 0 or 2$"):
        encode(request(EpsonInputs(1, 0.0, (1, 2, 3))), LITTLE_ENDIAN)
    with pytest.raises(FieldError, match=r'^bits\[1\] = 0.5: must be an int32$'):
        encode(request(EpsonInputs(1, 0.0, (1, 0.5))), LITTLE_ENDIAN)  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True)
class MoreInputs(EpsonInputs):
    """A message with the fields of another one and an additional one."""

    module: int = 0


def test_message_with_the_fields_of_another_is_decoded() -> None:
    row = FixedLayout(1501, MoreInputs, 'bank:i gain:r bits:0|2i module:i')
    message = MoreInputs(1, 0.5, (2, 3), 4)
    for dialect in DIALECTS:
        received = row.decode(row.encode(message, dialect), dialect.byte_order)[0]
        assert received == message
        assert hash(received) == hash(message)


def test_vendor_message_without_a_row_is_opaque() -> None:
    body = struct.pack('<if', 3, 0.5)
    packet = decode(Frame(1500, 1, 0, body, ByteOrder.LITTLE))
    assert packet.message == Opaque(1500, body)
    assert encode(packet, LITTLE_ENDIAN) == struct.pack('<4i', 20, 1500, 1, 0) + body


def test_row_that_does_not_match_its_class_is_refused() -> None:
    with pytest.raises(TypeError, match=r"EpsonInputs: layout names \('bank', 'bits', 'gain'\)"):
        FixedLayout(1500, EpsonInputs, 'bank:i bits:0|2i gain:r')


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
def test_figure_is_decoded_in_little_endian(example: Example) -> None:
    (frame,) = frames_of(example.little)
    assert frame.byte_order is ByteOrder.LITTLE
    assert contents(decode(frame)) == contents(example.packet)


@pytest.mark.parametrize('example', EXAMPLES, ids=lambda example: example.name)
def test_figure_is_decoded_in_big_endian(example: Example) -> None:
    (frame,) = frames_of(example.big)
    assert frame.byte_order is ByteOrder.BIG
    packet = decode(frame)
    assert contents(packet) == contents(example.packet)
    assert packet.dialect == BIG_ENDIAN


def contents(packet: Packet) -> tuple[object, ...]:
    return packet.msg_type, packet.comm_type, packet.reply_code, as_float32(packet.message)


def test_figure_4_has_the_joint_values_of_the_thesis() -> None:
    printed = [-3.6919e-05, -3.916e-06, -2.2920e-05, -8.7777e-05, -5.4792e-05, -8.6886e-05]
    message = decode(frames_of(EXAMPLES[0].little)[0]).message
    assert message.joints == pytest.approx(printed + [0.0] * 4, rel=1e-4, abs=0.0)


def test_figure_6_has_the_joint_values_of_the_thesis() -> None:
    printed = [-3.1e-15, 0.327742815, -0.865697324, -3.141592741, 0.705099046, -3.141592741]
    message = decode(frames_of(EXAMPLES[2].little)[0]).message
    assert message.joints[0] == pytest.approx(printed[0], rel=0.01)
    assert message.joints[1:] == pytest.approx(printed[1:] + [0.0] * 4, rel=1e-9, abs=0.0)
    assert (message.velocity, message.duration) == pytest.approx((0.1, 5.0), rel=1e-7)


def test_stream_of_all_examples_is_decoded_in_order() -> None:
    framer = Framer()
    framer.receive_data(b''.join(example.little for example in EXAMPLES))
    for example in EXAMPLES:
        frame = framer.next_frame()
        assert frame is not None
        assert contents(decode(frame)) == contents(example.packet)
    assert framer.next_frame() is None
