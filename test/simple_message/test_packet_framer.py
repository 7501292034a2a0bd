# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Packets from bytes at once are those of `Framer` and `decode`, whatever came before."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples
from wire_examples import DIALECTS, EXAMPLES, bits, packets

from epson_driver.simple_message import (
    ByteOrder,
    FrameError,
    Framer,
    JointPosition,
    PacketFramer,
    SimpleMessageError,
    decode,
    encode,
    topic,
)

Outcome = list[object]


def in_two_steps(chunks: list[bytes], order: ByteOrder | None) -> Outcome:
    """Return packets, and the texts of errors, as `next_frame` and `decode` give them."""
    framer, outcome = Framer(order), []
    for chunk in chunks:
        framer.receive_data(chunk)
        while True:
            try:
                frame = framer.next_frame()
                if frame is None:
                    break
                outcome.append(seen(decode(frame)))
            except FrameError as error:
                return [*outcome, str(error)]
            except SimpleMessageError as error:
                outcome.append(str(error))
    return outcome


def at_once(framer: PacketFramer, chunks: list[bytes]) -> Outcome:
    """Return the same as `next_packet` gives it."""
    outcome: Outcome = []
    for chunk in chunks:
        framer.receive_data(chunk)
        while True:
            try:
                packet = framer.next_packet()
                if packet is None:
                    break
                outcome.append(seen(packet))
            except FrameError as error:
                return [*outcome, str(error)]
            except SimpleMessageError as error:
                outcome.append(str(error))
    return outcome


def seen(packet):
    return bits(packet.message), packet[1:]


@pytest.mark.invariant(7, 8)
@settings(max_examples=examples(50))
@given(data=st.data())
def test_invariant_8_headers_that_came_before_change_nothing(data: st.DataObject) -> None:
    """Frames repeat their headers, with other bodies; some bytes are wrong; cut anywhere."""
    dialect = data.draw(st.sampled_from(DIALECTS))
    few = data.draw(st.lists(packets(dialect), min_size=1, max_size=3))
    frames = [encode(packet, dialect) for packet in few] * 3
    for at in data.draw(st.lists(st.integers(0, len(frames) - 1), max_size=3)):
        place = data.draw(st.integers(4, len(frames[at]) - 1))
        byte = data.draw(st.integers(0, 255))
        frames[at] = frames[at][:place] + bytes([byte]) + frames[at][place + 1 :]
    stream = b''.join(frames) + data.draw(st.binary(max_size=30))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    chunks = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    order = data.draw(st.sampled_from([None, dialect.byte_order]))
    assert at_once(PacketFramer(order), chunks) == in_two_steps(chunks, order)


def test_one_byte_at_a_time() -> None:
    stream = b''.join(example.little for example in EXAMPLES) * 2
    chunks = [stream[at : at + 1] for at in range(len(stream))]
    assert at_once(PacketFramer(), chunks) == in_two_steps([stream], None)


def test_a_body_of_another_length_is_read_as_its_own_layout() -> None:
    """One type, one header but for the length: float32, float64, and neither."""
    framer = PacketFramer()
    for _ in range(2):
        for dialect in DIALECTS[:2]:
            framer.receive_data(encode(topic(JointPosition(7, (0.5,) * 10)), dialect))
            packet = framer.next_packet()
            assert packet is not None
            assert packet.message == JointPosition(7, (0.5,) * 10)
            assert packet.dialect == dialect
        framer.receive_data(struct.pack('<4i', 12 + 43, 10, 1, 0) + bytes(43))
        with pytest.raises(SimpleMessageError, match='43 bytes'):
            framer.next_packet()


@pytest.mark.invariant(7)
def test_invariant_7_headers_that_no_controller_sends_are_not_kept() -> None:
    framer = PacketFramer()
    for number in range(1000):
        for body in (b'', bytes(44)):
            words = (12 + len(body), 70000 + number, 1 + number % 3, number % 4)
            framer.receive_data(struct.pack('<4i', *words) + body)
            try:
                framer.next_packet()
            except SimpleMessageError:
                continue
    kept = [value for value in vars(framer).values() if isinstance(value, dict)]
    assert kept == [{}]
