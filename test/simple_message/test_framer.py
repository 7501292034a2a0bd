# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Framing of any segmentation, both byte orders, and invalid bytes."""

import contextlib
import struct
import tracemalloc
from collections.abc import Sized
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples
from wire_examples import DIALECTS, EXAMPLES, bits, drain, frames_of, packets

from epson_driver.simple_message import (
    BodyError,
    ByteOrder,
    Frame,
    FrameError,
    Framer,
    HeaderError,
    PacketFramer,
    SimpleMessageError,
    decode,
    encode,
)

STREAM = b''.join(example.little for example in EXAMPLES)
ORDERS = pytest.mark.parametrize('order', ByteOrder, ids=lambda order: order.name)


def held(framer: Framer) -> int:
    """Return the number of bytes stored in the framer."""
    return sum(len(value) for value in vars(framer).values() if isinstance(value, Sized))


def frame_bytes(length: int, order: ByteOrder = ByteOrder.LITTLE) -> bytes:
    """Return a STATUS-typed frame whose prefix is `length`, with a body of that length."""
    return struct.pack(order.value + '4i', length, 13, 1, 0) + bytes(max(length - 12, 0))


def outcome(framer: Framer, chunks: list[bytes]) -> tuple[list[Frame], str]:
    """Return the frames of the chunks, and the text of the error at their end."""
    frames = []
    for chunk in chunks:
        framer.receive_data(chunk)
        try:
            while (frame := framer.next_frame()) is not None:
                frames.append(frame)
        except FrameError as error:
            return frames, str(error)
    return frames, ''


def cut(data: bytes, cuts: list[int]) -> list[bytes]:
    """Return the data in pieces, which are empty between equal cuts."""
    at = [0, *sorted(min(position, len(data)) for position in cuts), len(data)]
    return [data[start:end] for start, end in pairwise(at)]


def test_frame_is_returned_with_its_last_byte() -> None:
    framer = Framer()
    ends = []
    end = 0
    for item in EXAMPLES:
        end += len(item.little)
        ends.append(end)
    complete = []
    for position in range(len(STREAM)):
        framer.receive_data(STREAM[position : position + 1])
        complete += [position + 1] * len(drain(framer))
    assert complete == ends


@settings(max_examples=examples(60))
@given(data=st.data())
def test_any_segmentation_gives_the_same_frames(data: st.DataObject) -> None:
    dialect = data.draw(st.sampled_from(DIALECTS))
    sent = data.draw(st.lists(packets(dialect), min_size=1, max_size=5))
    stream = b''.join(encode(packet, dialect) for packet in sent)
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=12))
    whole = frames_of(stream)
    assert [bits(decode(frame).message) for frame in whole] == [bits(p.message) for p in sent]
    assert outcome(Framer(), cut(stream, cuts)) == (whole, '')


@given(
    stream=st.binary(max_size=200) | st.binary(max_size=20).map(lambda tail: STREAM + tail),
    cuts=st.lists(st.integers(0, 800), max_size=12),
)
def test_any_segmentation_gives_the_same_error(stream: bytes, cuts: list[int]) -> None:
    assert outcome(Framer(), cut(stream, cuts)) == outcome(Framer(), [stream])


@ORDERS
def test_byte_order_is_detected_from_the_first_length(order: ByteOrder) -> None:
    framer = Framer()
    assert framer.byte_order is None
    framer.receive_data(frame_bytes(40, order)[:4])
    assert framer.next_frame() is None
    assert framer.byte_order is order
    framer.receive_data(frame_bytes(40, order)[4:])
    assert framer.next_frame() == Frame(13, 1, 0, bytes(28), order)


@ORDERS
def test_detected_byte_order_stays(order: ByteOrder) -> None:
    other = ByteOrder.BIG if order is ByteOrder.LITTLE else ByteOrder.LITTLE
    framer = Framer()
    framer.receive_data(frame_bytes(40, order) + frame_bytes(40, other))
    assert framer.next_frame() is not None
    with pytest.raises(FrameError):
        framer.next_frame()


@ORDERS
def test_configured_byte_order_refuses_the_other(order: ByteOrder) -> None:
    other = ByteOrder.BIG if order is ByteOrder.LITTLE else ByteOrder.LITTLE
    framer = Framer(other)
    framer.receive_data(frame_bytes(0x38, order))
    with pytest.raises(FrameError) as error:
        framer.next_frame()
    assert error.value.value == 0x38000000
    assert str(error.value) == ('length = 939524096: must be 12 … 65535; is the byte order right?')


@pytest.mark.invariant(7)
@ORDERS
@pytest.mark.parametrize('length', [0, -1, -(2**31), 11, 65536, 2**31 - 1])
def test_inv7_invalid_length_is_refused(order: ByteOrder, length: int) -> None:
    framer = Framer(order)
    framer.receive_data(struct.pack(order.value + 'i', length))
    with pytest.raises(FrameError) as error:
        framer.next_frame()
    assert (error.value.field, error.value.value) == ('length', length)


@ORDERS
@pytest.mark.parametrize('length', [12, 13, 65534, 65535])
def test_minimum_and_maximum_lengths_are_accepted(order: ByteOrder, length: int) -> None:
    for framer in (Framer(order), Framer()):
        (frame,) = frames_of(frame_bytes(length, order), framer)
        assert len(frame.body) == length - 12


@pytest.mark.invariant(7)
@pytest.mark.parametrize('prefix', ['00000000', 'ffffffff', '0b000000', '0000000b', '01000001'])
def test_inv7_length_invalid_in_both_orders_is_refused(prefix: str) -> None:
    framer = Framer()
    framer.receive_data(bytes.fromhex(prefix))
    with pytest.raises(FrameError):
        framer.next_frame()
    assert framer.byte_order is None


@ORDERS
def test_maximum_length_can_be_lowered(order: ByteOrder) -> None:
    assert frames_of(frame_bytes(64, order), Framer(max_length=64)) != []
    for framer in (Framer(max_length=64), Framer(order, max_length=64)):
        with pytest.raises(FrameError, match=r'must be 12 … 64; is the byte order right\?'):
            frames_of(frame_bytes(65, order), framer)


def test_complete_frames_before_an_invalid_length_are_returned() -> None:
    framer = Framer()
    framer.receive_data(STREAM + bytes(4) + STREAM)
    for _ in EXAMPLES:
        assert framer.next_frame() is not None
    with pytest.raises(FrameError):
        framer.next_frame()


def test_error_repeats_for_all_later_bytes() -> None:
    framer = Framer(ByteOrder.LITTLE)
    framer.receive_data(bytes(4))
    texts = set()
    for chunk in (b'', STREAM, bytes(4), b'\x38'):
        with pytest.raises(FrameError) as error:
            framer.next_frame()
        texts.add(str(error.value))
        framer.receive_data(chunk)
    assert texts == {'length = 0: must be 12 … 65535; is the byte order right?'}


@pytest.mark.invariant(7)
def test_inv7_memory_is_bounded_after_an_error() -> None:
    framer = Framer()
    framer.receive_data(bytes(4))

    def go_on(times: int) -> None:
        for _ in range(times):
            framer.receive_data(bytes(65536))
            try:
                framer.next_frame()
            except FrameError:
                continue
            raise AssertionError('the error did not repeat')

    tracemalloc.start()
    try:
        go_on(100)
        before, _ = tracemalloc.get_traced_memory()
        go_on(1000)
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held(framer) == 0
    assert after - before < 4096  # an error object that is raised repeatedly grows


@pytest.mark.invariant(7)
def test_inv7_memory_is_bounded_during_a_slow_long_frame() -> None:
    stream = frame_bytes(65535)
    framer = Framer()
    for _ in range(3):
        for at in range(0, len(stream), 1000):
            chunk = stream[at : at + 1000]
            framer.receive_data(chunk)
            assert held(framer) <= 65535 + 4 + len(chunk)
            drain(framer)
    assert framer.next_frame() is None


@pytest.mark.invariant(7)
@settings(max_examples=examples(200))
@given(data=st.data(), max_length=st.sampled_from([12, 64, 300, 65535]))
def test_inv7_arbitrary_bytes_raise_only_frame_errors_and_bound_memory(
    data: st.DataObject, max_length: int
) -> None:
    order = data.draw(st.sampled_from([None, *ByteOrder]))
    framer = Framer(order, max_length)
    broken = False
    for chunk in data.draw(st.lists(_chunks(), max_size=8)):
        framer.receive_data(chunk)
        assert held(framer) <= max_length + 4 + len(chunk)
        try:
            while (frame := framer.next_frame()) is not None:
                assert not broken
                assert 12 + len(frame.body) <= max_length
                with contextlib.suppress(HeaderError, BodyError):
                    packet = decode(frame)
                    assert len(encode(packet, packet.dialect)) <= 4 + max_length
        except FrameError:
            broken = True
            assert held(framer) == 0


def _chunks() -> st.SearchStrategy[bytes]:
    """Return random bytes, random frames, and frames with one wrong byte."""
    word = st.integers(-2, 20) | st.integers(-(2**31), 2**31 - 1)
    framed = st.builds(
        lambda order, header, body: (
            struct.pack(order.value + '4i', 12 + len(body), *header) + body
        ),
        st.sampled_from(ByteOrder),
        st.tuples(word, st.integers(-1, 4), st.integers(-1, 3)),
        st.sampled_from(
            [0, 4, 12, 28, 40, 44, 52, 84, 100, 132, 136, 256, 260, 524, 1004]
        ).flatmap(lambda size: st.binary(min_size=size, max_size=size)),
    )
    spoiled = st.builds(
        lambda wire, at, byte: wire[: at % len(wire)] + bytes([byte]) + wire[at % len(wire) + 1 :],
        st.sampled_from([side for item in EXAMPLES for side in (item.little, item.big)]),
        st.integers(0, 200),
        st.integers(0, 255),
    )
    return st.one_of(st.binary(max_size=80), framed, spoiled)


Outcome = list[object]


def in_two_steps(chunks: list[bytes], order: ByteOrder | None) -> Outcome:
    """Return the packets and error texts of `next_frame` and `decode`."""
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
    """Return the packets and error texts of `next_packet`."""
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
def test_inv8_repeated_headers_do_not_change_the_result(data: st.DataObject) -> None:
    """Frames have repeated headers, other bodies, some wrong bytes, and any segmentation."""
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


@pytest.mark.invariant(7)
def test_inv7_unknown_headers_are_not_cached() -> None:
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
