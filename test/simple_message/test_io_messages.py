# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The messages of I/O and of Motoman, byte by byte."""

import struct
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples
from wire_examples import DIALECTS, FLOAT32, HEADERS, INT32, bits, frames_of

from epson_driver.simple_message import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    BodyError,
    ByteOrder,
    CommType,
    Dialect,
    FieldError,
    Frame,
    IoAddress,
    IoRange,
    IoSetting,
    Message,
    MotionCtrl,
    MotionReply,
    Opaque,
    Packet,
    ReplyCode,
    decode,
    encode,
    reply,
    request,
    topic,
)
from epson_driver.simple_message.io_layouts import MAX_ITEMS, MAX_VALUES
from epson_driver.simple_message.io_messages import (
    IoInfo,
    IoInfoReply,
    IoOutcome,
    IoPublish,
    IoRead,
    IoReading,
    IoReadReply,
    IoReset,
    IoResetReply,
    IoSpan,
    IoSubscribe,
    IoSubscribeReply,
    IoUnsubscribe,
    IoUnsubscribeReply,
    IoValues,
    IoWrite,
    IoWriteReply,
)
from epson_driver.simple_message.motoman import (
    GENERAL_INPUTS,
    GENERAL_OUTPUTS,
    Command,
    Invalid,
    IoCtrlReply,
    ReadIoBit,
    ReadIoBitReply,
    ReadIoGroup,
    ReadIoGroupReply,
    Result,
    WriteIoBit,
    WriteIoBitReply,
    WriteIoGroup,
    WriteIoGroupReply,
    bit_address,
)

REQUEST, REPLY, TOPIC = (2, 0), (3, 1), (1, 0)

# message, msg_type, (comm_type, reply_code), the body's words
GOLDEN = (
    (IoInfo(7), 65200, REQUEST, (7,)),
    (
        IoInfoReply(7, 1, (IoRange(1, 0, 24, 2), IoRange(5, 1000, 2, 2))),
        65200,
        REPLY,
        (7, 1, 2, 1, 0, 24, 2, 5, 1000, 2, 2),
    ),
    (IoRead(8, (IoAddress(1, 3), IoAddress(3, 0))), 65201, REQUEST, (8, 2, 1, 3, 3, 0)),
    (
        IoReadReply(8, 1500, (IoReading(1, 3, 1, 1), IoReading(9, 0, 1001, 0))),
        65201,
        REPLY,
        (8, 1500, 2, 1, 3, 1, 1, 9, 0, 1001, 0),
    ),
    (
        IoWrite(9, (IoSetting(2, 4, 1), IoSetting(4, 1, -2500))),
        65202,
        REQUEST,
        (9, 2, 2, 4, 1, 4, 1, -2500),
    ),
    (
        IoWriteReply(9, 1501, (IoOutcome(2, 4, 1), IoOutcome(4, 1, 2002))),
        65202,
        REPLY,
        (9, 1501, 2, 2, 4, 1, 4, 1, 2002),
    ),
    (IoReset(10, (IoAddress(-1, -1),)), 65203, REQUEST, (10, 1, -1, -1)),
    (IoResetReply(10, (IoOutcome(-1, -1, 1),)), 65203, REPLY, (10, 1, -1, -1, 1)),
    (IoSubscribe(11, (IoSpan(1, 4, 2),)), 65204, REQUEST, (11, 1, 1, 4, 2)),
    (IoSubscribeReply(11, (IoOutcome(1, 4, 1),)), 65204, REPLY, (11, 1, 1, 4, 1)),
    (IoUnsubscribe(12, (IoAddress(1, 4),)), 65205, REQUEST, (12, 1, 1, 4)),
    (IoUnsubscribeReply(12, (IoOutcome(1, 4, 2003),)), 65205, REPLY, (12, 1, 1, 4, 2003)),
    (
        IoPublish(1502, (IoValues(1, 4, (0, 1)), IoValues(3, 0, (-9999,)))),
        65206,
        TOPIC,
        (1502, 2, 1, 4, 2, 0, 1, 3, 0, 1, -9999),
    ),
    (IoRead(), 65201, REQUEST, (0, 0)),
    (IoPublish(3), 65206, TOPIC, (3, 0)),
)


def wire(
    msg_type: int, header: tuple[int, int], words: tuple[int, ...], order: str = '<'
) -> bytes:
    return struct.pack(f'{order}{4 + len(words)}i', 12 + 4 * len(words), msg_type, *header, *words)


def packet_of(message: Message, header: tuple[int, int]) -> Packet:
    return Packet(message, CommType(header[0]), ReplyCode(header[1]))


GOLDEN_IDS = [f'{type(row[0]).__name__} {len(row[3])}' for row in GOLDEN]


@pytest.mark.parametrize(('message', 'msg_type', 'header', 'words'), GOLDEN, ids=GOLDEN_IDS)
@pytest.mark.parametrize('dialect', [LITTLE_ENDIAN, BIG_ENDIAN], ids=['little', 'big'])
def test_encoded_io_message_has_the_words_of_the_table(
    message: Message,
    msg_type: int,
    header: tuple[int, int],
    words: tuple[int, ...],
    dialect: Dialect,
) -> None:
    expected = wire(msg_type, header, words, dialect.byte_order.value)
    assert encode(packet_of(message, header), dialect) == expected
    (frame,) = frames_of(expected)
    packet = decode(frame)
    assert packet.message == message
    assert packet.msg_type == msg_type
    assert packet.dialect == dialect


ADDRESSES = st.lists(st.builds(IoAddress, INT32, INT32), max_size=6).map(tuple)
OUTCOMES = st.lists(st.builds(IoOutcome, INT32, INT32, INT32), max_size=6).map(tuple)
VALUES = st.builds(IoValues, INT32, INT32, st.lists(INT32, max_size=5).map(tuple))
REQUESTS = st.one_of(
    st.builds(IoInfo, INT32),
    st.builds(IoRead, INT32, ADDRESSES),
    st.builds(
        IoWrite, INT32, st.lists(st.builds(IoSetting, INT32, INT32, INT32), max_size=6).map(tuple)
    ),
    st.builds(IoReset, INT32, ADDRESSES),
    st.builds(
        IoSubscribe, INT32, st.lists(st.builds(IoSpan, INT32, INT32, INT32), max_size=6).map(tuple)
    ),
    st.builds(IoUnsubscribe, INT32, ADDRESSES),
).map(request)
REPLIES = st.one_of(
    st.builds(
        IoInfoReply,
        INT32,
        INT32,
        st.lists(st.builds(IoRange, INT32, INT32, INT32, INT32), max_size=6).map(tuple),
    ),
    st.builds(
        IoReadReply,
        INT32,
        INT32,
        st.lists(st.builds(IoReading, INT32, INT32, INT32, INT32), max_size=6).map(tuple),
    ),
    st.builds(IoWriteReply, INT32, INT32, OUTCOMES),
    st.builds(IoResetReply, INT32, OUTCOMES),
    st.builds(IoSubscribeReply, INT32, OUTCOMES),
    st.builds(IoUnsubscribeReply, INT32, OUTCOMES),
).map(lambda message: reply(message, ReplyCode.SUCCESS))
TOPICS = st.builds(IoPublish, INT32, st.lists(VALUES, max_size=4).map(tuple)).map(topic)


@pytest.mark.parametrize('order', ByteOrder, ids=lambda order: order.name)
@settings(max_examples=examples(100))
@given(packet=REQUESTS | REPLIES | TOPICS)
def test_io_message_round_trip(order: ByteOrder, packet: Packet) -> None:
    (frame,) = frames_of(encode(packet, Dialect(order)))
    received = decode(frame)
    assert received.message == packet.message
    assert (received.comm_type, received.reply_code) == (packet.comm_type, packet.reply_code)


@settings(max_examples=examples(300))
@given(
    msg_type=st.integers(65200, 65206),
    header=st.sampled_from([REQUEST, REPLY, TOPIC]),
    body=st.binary(max_size=80)
    | st.lists(st.integers(-2, 8), max_size=16).map(lambda w: struct.pack(f'<{len(w)}i', *w)),
)
def test_arbitrary_body_is_a_message_or_a_body_error(
    msg_type: int, header: tuple[int, int], body: bytes
) -> None:
    try:
        packet = decode(Frame(msg_type, *header, body, ByteOrder.LITTLE))
    except BodyError:
        assert header != REPLY
        return
    assert encode(packet, LITTLE_ENDIAN)[16:] == body


def frame(msg_type: int, *words: int, header: tuple[int, int] = REQUEST) -> Frame:
    body = struct.pack(f'<{len(words)}i', *words)
    return Frame(msg_type, *header, body, ByteOrder.LITTLE)


@pytest.mark.parametrize(
    ('wrong', 'text'),
    [
        (
            frame(65201, 1, 2, 1, 0),
            'num_items = 2: the items that follow have 8 bytes, 8 each',
        ),
        (frame(65202, 1, 1), 'num_items = 1: the items that follow have 0 bytes, 12 each'),
        (
            frame(65202, 1, 0, 2, 0, 1),
            'num_items = 0: the items that follow have 12 bytes, 12 each',
        ),
        (frame(65203, 1, -1), f'num_items = -1: must be 0 to {MAX_ITEMS}'),
        (frame(65204, 1, 2**31 - 1), f'num_items = 2147483647: must be 0 to {MAX_ITEMS}'),
        (
            frame(65205, 1),
            "body = '4 bytes': IoUnsubscribe has 8 bytes, and 4 for each further field",
        ),
        (
            Frame(65201, 2, 0, bytes(9), ByteOrder.LITTLE),
            "body = '9 bytes': IoRead has 8 bytes, and 4 for each further field",
        ),
        (frame(65200), "body = '0 bytes': IoInfo (msg_type 65200) has 4"),
        (
            frame(65206, 0, 1, 1, 0, 3, 1, 1, header=TOPIC),
            'items[0].count = 3: 2 values follow in the body',
        ),
        (
            frame(65206, 0, 1, 1, 0, -1, header=TOPIC),
            'items[0].count = -1: 0 values follow in the body',
        ),
        (
            frame(65206, 0, 2, 1, 0, 1, 1, header=TOPIC),
            'num_items = 2: the body ends in items[1]',
        ),
        (
            frame(65206, 0, 1, 1, 0, 1, 1, 7, header=TOPIC),
            'num_items = 1: 4 bytes follow after the last item',
        ),
        (frame(65206, 0, MAX_ITEMS + 1, header=TOPIC), 'num_items = 1025: must be 0 to 1024'),
    ],
    ids=lambda value: value if isinstance(value, str) else str(value.msg_type),
)
def test_body_error_names_field_value_and_rule(wrong: Frame, text: str) -> None:
    with pytest.raises(BodyError) as error:
        decode(wrong)
    assert str(error.value) == text


@pytest.mark.parametrize(
    ('packet', 'text'),
    [
        (request(IoRead(2**31)), 'message_id = 2147483648: must be an int32'),
        (
            request(IoWrite(0, (IoSetting(2, 0, 1), IoSetting(2, 1, -(2**31) - 1)))),
            'items[1].value = -2147483649: must be an int32',
        ),
        (
            request(IoWrite(0, (IoSetting(2, 0, 0.5),))),  # type: ignore[arg-type]
            'items[0].value = 0.5: must be an int32',
        ),
        (request(IoRead(0, (IoAddress(1, 0),) * 1025)), 'items = 1025: at most 1024'),
        (
            topic(IoPublish(0, (IoValues(1, 0, (0, 2**40)),))),
            'items[0].values[1] = 1099511627776: must be an int32',
        ),
        (
            topic(IoPublish(0, (IoValues(1, 0, (0,) * MAX_VALUES), IoValues(2, 0, (1,))))),
            f'values = {MAX_VALUES + 1}: at most {MAX_VALUES} in all items',
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value.message).__name__,
)
def test_encode_error_names_field_value_and_rule(packet: Packet, text: str) -> None:
    with pytest.raises(FieldError) as error:
        encode(packet, LITTLE_ENDIAN)
    assert str(error.value) == text


@pytest.mark.parametrize(
    'packet',
    [
        reply(IoReadReply(1, 2, (IoReading(1, 0, 1, 1),) * MAX_ITEMS), ReplyCode.SUCCESS),
        reply(IoInfoReply(1, 2, (IoRange(1, 0, 1, 1),) * MAX_ITEMS), ReplyCode.SUCCESS),
        topic(
            IoPublish(
                0, (IoValues(1, 0, (1,) * (MAX_VALUES - 1023)),) + (IoValues(2, 0, (0,)),) * 1023
            )
        ),
    ],
    ids=lambda packet: type(packet.message).__name__,
)
def test_longest_io_message_is_accepted(packet: Packet) -> None:
    (longest,) = frames_of(encode(packet, LITTLE_ENDIAN))
    assert decode(longest).message == packet.message


@pytest.mark.parametrize(('msg_type', 'code'), [*product(range(65200, 65206), (1, 2))])
def test_reply_without_a_body_is_opaque(msg_type: int, code: int) -> None:
    packet = decode(Frame(msg_type, 3, code, b'', ByteOrder.LITTLE))
    assert packet.message == Opaque(msg_type)
    assert packet.reply_code is ReplyCode(code)


def test_same_words_have_another_meaning_in_a_reply() -> None:
    words = (5, 1, 0)
    assert decode(frame(65201, 5, 0)).message == IoRead(5)
    assert decode(frame(65201, *words, header=REPLY)).message == IoReadReply(5, 1)
    with pytest.raises(BodyError):
        decode(frame(65201, *words))


@pytest.mark.parametrize('dialect', DIALECTS, ids=str)
@settings(max_examples=examples(40))
@given(data=st.data())
def test_motoman_values_round_trip_bit_exact(dialect: Dialect, data: st.DataObject) -> None:
    ten = st.tuples(*[FLOAT32] * 10)
    message = data.draw(
        st.builds(MotionCtrl, INT32, INT32, INT32, ten)
        | st.builds(MotionReply, INT32, INT32, INT32, INT32, INT32, ten)
    )
    packet = Packet(message, *data.draw(HEADERS), dialect=dialect)
    (frame,) = frames_of(encode(packet, dialect))
    received = decode(frame)
    assert bits(received.message) == bits(message)
    assert received.dialect == dialect


MESSAGES = [
    (
        2001,  # equals a capture
        request(MotionCtrl(0, 7, Command.CHECK_MOTION_READY)),
        (0, 7, 200101, *[0] * 10),
    ),
    (
        2002,
        reply(MotionReply(1, 3, 14, Result.INVALID, Invalid.DATA_START_POS), ReplyCode.SUCCESS),
        (1, 3, 14, 3, 3011, *[0] * 10),
    ),
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
def test_messages_have_the_bytes_of_motoros(msg_type, packet, words, order, dialect):
    header = (12 + 4 * len(words), msg_type, packet.comm_type, packet.reply_code)
    wire = struct.pack(f'{order}{4 + len(words)}i', *header, *words)
    assert encode(packet, dialect) == wire
    (frame,) = frames_of(wire)
    assert decode(frame).message == packet.message
    assert dialect in DIALECTS


def test_bit_addresses_are_those_of_the_teach_pendant():
    assert [bit_address(GENERAL_INPUTS, index) for index in (0, 7, 8)] == [10, 17, 20]
    assert [bit_address(GENERAL_OUTPUTS, index) for index in (0, 15)] == [10010, 10027]
