# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What is encoded in any dialect comes back as it was, bit by bit."""

import struct
from dataclasses import FrozenInstanceError, dataclass, fields

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples
from wire_examples import DIALECTS, FLOAT32, INT32, ZEROS, bits, frames_of, packets

from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    BodyError,
    ByteOrder,
    Dialect,
    FieldError,
    Frame,
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
def test_invariant_8_every_message_comes_back_bit_exact(
    dialect: Dialect, data: st.DataObject
) -> None:
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
def test_invariant_8_measured_values_keep_bits_order_and_sign(
    order: ByteOrder, words: list[float]
) -> None:
    body = struct.pack(f'{order.value}ii31f', 1, 15, *words)
    packet = decode(Frame(15, 1, 0, body, order))
    message = packet.message
    assert isinstance(message, JointFeedback)
    measured = (message.time, *message.positions, *message.velocities, *message.accelerations)
    assert bits(measured) == bits(tuple(words))
    assert encode(packet, packet.dialect)[16:] == body


def test_a_real_is_rounded_to_the_nearest_float32() -> None:
    wire = encode(topic(JointPosition(0, (0.1, *ZEROS[1:]))), LITTLE_ENDIAN)
    received = decode(frames_of(wire)[0]).message.joints[0]
    assert received == 0.100000001490116119384765625
    wire = encode(topic(JointPosition(0, (0.1, *ZEROS[1:]))), Dialect(real=Real.FLOAT64))
    assert decode(frames_of(wire)[0]).message.joints[0] == 0.1


@pytest.mark.parametrize('dialect', DIALECTS, ids=str)
@settings(max_examples=examples(20))
@given(data=st.data())
def test_a_received_message_is_like_one_that_was_made(
    dialect: Dialect, data: st.DataObject
) -> None:
    """Of its own class, with its repr, and nobody can change it."""
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
    """A vendor's message as a user would add it, in EPSON's range of ids."""

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
def test_a_vendor_message_is_one_class_and_one_row(dialect: Dialect) -> None:
    @settings(max_examples=examples(20))
    @given(bank=INT32, gain=FLOAT32, held=st.just(()) | st.tuples(INT32, INT32))
    def round_trip(bank: int, gain: float, held: tuple[int, ...]) -> None:
        message = EpsonInputs(bank, gain, held)
        received = decode(frames_of(encode(topic(message), dialect))[0])
        assert bits(received.message) == bits(message)
        assert received.msg_type == 1500

    round_trip()


@pytest.mark.usefixtures('_epson_inputs')
def test_a_vendor_message_has_the_errors_of_every_message() -> None:
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
    """A message that has the fields of another one, and more."""

    module: int = 0


def test_a_message_with_the_fields_of_another_comes_back() -> None:
    row = FixedLayout(1501, MoreInputs, 'bank:i gain:r bits:0|2i module:i')
    message = MoreInputs(1, 0.5, (2, 3), 4)
    for dialect in DIALECTS:
        received = row.decode(row.encode(message, dialect), dialect.byte_order)[0]
        assert received == message
        assert hash(received) == hash(message)


def test_without_its_row_a_vendor_message_is_opaque() -> None:
    body = struct.pack('<if', 3, 0.5)
    packet = decode(Frame(1500, 1, 0, body, ByteOrder.LITTLE))
    assert packet.message == Opaque(1500, body)
    assert encode(packet, LITTLE_ENDIAN) == struct.pack('<4i', 20, 1500, 1, 0) + body


def test_a_row_that_does_not_fit_its_class_is_refused() -> None:
    with pytest.raises(TypeError, match=r"EpsonInputs: layout names \('bank', 'bits', 'gain'\)"):
        FixedLayout(1500, EpsonInputs, 'bank:i bits:0|2i gain:r')
