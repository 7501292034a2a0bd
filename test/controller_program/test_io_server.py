# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""io.prg: docs/io.md's messages on the controller's inputs, outputs and memory bits."""

import pytest
from support.spel_program_harness import OUR_FILES, OurProgramHarness

from epson_driver.simple_message import (
    GetVersion,
    IoAddress,
    IoRange,
    IoSetting,
    MessageType,
    Opaque,
    ReplyCode,
    reply,
    request,
    topic,
)
from epson_driver.simple_message.io_messages import (
    IoInfo,
    IoInfoReply,
    IoOutcome,
    IoPublish,
    IoRead,
    IoReading,
    IoReset,
    IoResetReply,
    IoSpan,
    IoSubscribe,
    IoSubscribeReply,
    IoUnsubscribe,
    IoUnsubscribeReply,
    IoWrite,
)

DI, DO, AI, GI, GO, FLAG = 1, 2, 3, 5, 6, 7
DONE, NO_TYPE, READ_ONLY, NO_INDEX, NO_VALUE, NO_RANGE, TOO_MUCH = (
    1, 1001, 1002, 2001, 2002, 2003, 65001,
)  # fmt: skip


@pytest.fixture
def harness():
    return OurProgramHarness()


@pytest.fixture
def client(harness):
    return harness.connect('io')


def ask(client, message):
    """Return the reply to a request."""
    client.packets()
    client.send(request(message))
    answers = []

    def answered():
        answers.extend(packet for packet in client.packets() if packet.reply_code)
        return answers

    client.harness.until(answered)
    (answer,) = answers
    assert answer.reply_code is ReplyCode.SUCCESS
    return answer.message


def on(harness, io_type, count=16):
    """Return the points of a type that are 1."""
    return {n for n in range(count) if harness.controller.io.read(io_type, n)}


def set_inputs(harness, *indices):
    for index in indices:
        harness.controller.io.set_input(DI, index, 1)


def test_info_lists_the_ranges(harness, client):
    ranges = (
        IoRange(DI, 0, 24, 2),
        IoRange(DO, 0, 16, 3),
        IoRange(GI, 0, 3, 2),
        IoRange(GI, 1000, 1, 2),
        IoRange(GO, 0, 2, 3),
        IoRange(GO, 1000, 1, 3),
        IoRange(FLAG, 0, 64, 3),
    )
    assert ask(client, IoInfo(77)) == IoInfoReply(77, 1, ranges)


def test_read_answers_each_item(harness, client):
    set_inputs(harness, 1, 9, 15)
    harness.controller.io.write(DO, 3, 1)
    harness.controller.io.write(FLAG, 63, 1)
    expected = {
        (DI, 1): (DONE, 1),
        (DI, 2): (DONE, 0),
        (DO, 3): (DONE, 1),
        (FLAG, 63): (DONE, 1),
        (GI, 1): (DONE, 0x82),
        (GI, 1000): (DONE, 0x8202),
        (GO, 0): (DONE, 8),
        (GO, 1000): (DONE, 8),
        (AI, 0): (NO_TYPE, 0),
        (99, 0): (NO_TYPE, 0),
        (DI, 24): (NO_INDEX, 0),
        (DI, 1000): (NO_INDEX, 0),
        (DO, -1): (NO_INDEX, 0),
        (GI, 1001): (NO_INDEX, 0),
        (FLAG, 500): (NO_INDEX, 0),
        (FLAG, 1000): (NO_INDEX, 0),
        (DO, 2**31 - 1): (NO_INDEX, 0),
        (DO, 1000): (NO_INDEX, 0),
    }
    result = ask(client, IoRead(5, tuple(IoAddress(*item) for item in expected)))
    assert result.message_id == 5
    assert result.items == tuple(IoReading(*a, *b) for a, b in expected.items())
    assert 0 < result.timestamp <= harness.now * 1000


def test_write_sets_outputs(harness, client):
    expected = {
        (DO, 15, 1): DONE,
        (FLAG, 5, 1): DONE,
        (FLAG, 6, 0): DONE,
        (GO, 0, 0x81): DONE,
        (DO, 0, 0): DONE,
        (DO, 16, 1): NO_INDEX,
        (DO, 1, 2): NO_VALUE,
        (DO, 1, -1): NO_VALUE,
        (GO, 0, 256): NO_VALUE,
        (GO, 1000, 65536): NO_VALUE,
        (DI, 1, 1): READ_ONLY,
        (GI, 0, 1): READ_ONLY,
        (AI, 0, 1): NO_TYPE,
    }
    result = ask(client, IoWrite(6, tuple(IoSetting(*item) for item in expected)))
    assert result.items == tuple(IoOutcome(a, b, r) for (a, b, _), r in expected.items())
    assert on(harness, DO) == {7, 15}
    assert on(harness, FLAG, 64) == {5}
    ask(client, IoWrite(7, (IoSetting(GO, 1000, 0xC003),)))
    assert on(harness, DO) == {0, 1, 14, 15}


def test_stop_bit_cannot_be_written(harness, client):
    match = ask(client, IoWrite(1, (IoSetting(FLAG, 500, 1), IoSetting(FLAG, 64, 1))))
    assert [item.result for item in match.items] == [NO_INDEX, NO_INDEX]


def test_reset_clears_outputs(harness, client):
    for items, outputs, flags in (
        (((DO, 3),), {4, 12}, {3}),
        (((GO, 1),), {3, 4}, {3}),
        (((FLAG, 3),), {3, 4, 12}, set()),
        (((DO, -1),), set(), {3}),
        (((GO, -1),), set(), {3}),
        (((FLAG, -1),), {3, 4, 12}, set()),
        (((-1, -1),), set(), set()),
    ):
        written = [IoSetting(DO, n, 1) for n in (3, 4, 12)] + [IoSetting(FLAG, 3, 1)]
        ask(client, IoWrite(1, tuple(written)))
        match = ask(client, IoReset(2, tuple(IoAddress(*element) for element in items)))
        assert match == IoResetReply(2, tuple(IoOutcome(*element, DONE) for element in items))
        assert on(harness, DO) == outputs
        assert on(harness, FLAG, 64) == flags
    wrong = (IoAddress(DI, 0), IoAddress(DI, -1), IoAddress(AI, -1), IoAddress(DO, 99))
    match = ask(client, IoReset(3, wrong))
    assert [item.result for item in match.items] == [READ_ONLY, READ_ONLY, NO_TYPE, NO_INDEX]


def test_publications_on_change_and_periodically(harness, client):
    spans = (IoSpan(DI, 0, 24), IoSpan(GO, 0, 2), IoSpan(FLAG, 0, 64))
    result = ask(client, IoSubscribe(8, spans))
    expected = tuple(IoOutcome(span.io_type, span.start, DONE) for span in spans)
    assert result == IoSubscribeReply(8, expected)
    harness.step(0.3)
    first = [element.message for element in client.packets()]
    assert [len(item.values) for item in first[0].items] == [24, 2, 64]
    harness.step(2.0)
    assert 3 <= len(client.packets()) <= 6
    set_inputs(harness, 4)
    harness.step(0.15)
    (packet,) = client.packets()[:1]
    assert isinstance(packet.message, IoPublish)
    assert packet.message.items[0].values == (0,) * 4 + (1,) + (0,) * 19
    result = ask(client, IoUnsubscribe(9, (IoAddress(DI, 0), IoAddress(DO, 0))))
    results = (IoOutcome(DI, 0, DONE), IoOutcome(DO, 0, NO_RANGE))
    assert result == IoUnsubscribeReply(9, results)
    ask(client, IoUnsubscribe(9, (IoAddress(GO, 0), IoAddress(FLAG, 0))))
    client.packets()
    harness.step(2.0)
    assert client.packets() == []


def test_largest_subscription_is_published(harness, client):
    spans = [IoSpan(FLAG, n, 64 - n) for n in range(5)] + [IoSpan(FLAG, 0, 1)]
    match = ask(client, IoSubscribe(1, tuple(spans)))
    assert [item.result for item in match.items] == [DONE] * 4 + [TOO_MUCH, DONE]
    spans = [IoSpan(DI, n, 1) for n in range(5)] + [IoSpan(DI, 0, 0), IoSpan(DI, 0, 25)]
    match = ask(client, IoSubscribe(1, tuple(spans)))
    assert [item.result for item in match.items] == [DONE] * 4 + [TOO_MUCH, NO_INDEX, NO_INDEX]
    harness.step(1.0)
    (*_, last) = client.packets()
    assert len(last.message.items) == 8


def test_outputs_are_cleared_when_their_client_disconnects(harness, client):
    ask(client, IoWrite(1, (IoSetting(DO, 3, 1), IoSetting(FLAG, 3, 1))))
    client.leave()
    harness.step(0.5)
    assert on(harness, DO) == set()
    assert on(harness, FLAG, 64) == {3}
    harness.controller.io.write(DO, 3, 1)
    reader = harness.connect('io')
    ask(reader, IoRead(1, (IoAddress(DO, 3),)))
    reader.leave()
    harness.step(0.5)
    assert on(harness, DO) == {3}


def test_config_may_keep_the_outputs():
    harness = OurProgramHarness(IO_OFF_WHEN_LOST='')
    client = harness.connect('io')
    ask(client, IoWrite(1, (IoSetting(DO, 3, 1),)))
    client.leave()
    harness.step(0.5)
    assert on(harness, DO) == {3}


def test_remote_outputs_of_rc_plus_are_read_only():
    """The shipped configuration reserves bits 0 to 7, their byte and their word."""
    assert '\n#define IO_FIRST_OUTPUT_BYTE 1\n' in OUR_FILES['config.inc']
    harness = OurProgramHarness(IO_FIRST_OUTPUT_BYTE='1')
    client = harness.connect('io')
    settings = (
        IoSetting(DO, 7, 1),
        IoSetting(DO, 8, 1),
        IoSetting(GO, 0, 1),
        IoSetting(GO, 1000, 1),
    )
    answer = ask(client, IoWrite(1, settings))
    assert [item.result for item in answer.items] == [1002, 1, 1002, 1002]
    harness.controller.io.write(DO, 2, 1)
    ask(client, IoReset(2, (IoAddress(DO, -1),)))
    assert on(harness, DO) == {2}


@pytest.mark.parametrize('event', ['E-stop press', 'door open'])
def test_outputs_are_written_in_an_estop_and_with_an_open_door(event):
    """SPEL+ reference, p. 560, p. 567: it needs Forced. The interpreter checks that."""
    harness = OurProgramHarness()
    client = harness.connect('io')
    harness.do(event)
    settings = (IoSetting(DO, 3, 1), IoSetting(GO, 1, 5), IoSetting(GO, 1000, 0x0108))
    answer = ask(client, IoWrite(1, settings))
    assert [item.result for item in answer.items] == [1, 1, 1]
    client.leave()
    harness.step(0.5)
    assert on(harness, DO) == set()


def test_other_messages_get_failure(harness, client):
    count = (5).to_bytes(4, 'little')
    huge = (2**31 - 1).to_bytes(4, 'little')
    client.send(request(GetVersion()), topic(IoInfo(1)))
    for body in (b'', count, count * 2, count + huge, count + b'\xff' * 4):
        client.send(request(Opaque(MessageType.IO_READ, body)))
    client.send(request(Opaque(MessageType.IO_INFO, count * 2)))
    harness.step(0.3)
    expected = [reply(GetVersion((0, 2, 0)), ReplyCode.SUCCESS)]
    expected += [reply(Opaque(MessageType.IO_READ), ReplyCode.FAILURE)] * 5
    expected += [reply(Opaque(MessageType.IO_INFO), ReplyCode.FAILURE)]
    got = client.raw()
    assert got.count(b'\x0c\0\0\0\xb1\xfe\0\0\x03\0\0\0\x02\0\0\0') == 5
    assert got.endswith(b'\x0c\0\0\0\xb0\xfe\0\0\x03\0\0\0\x02\0\0\0')
    assert client.open


def test_long_reply_is_sent_in_pieces(harness, client):
    """122 items have 1,976 bytes, and WriteBin accepts 1,023."""
    items = tuple(IoAddress(DI, n % 24) for n in range(122))
    assert len(ask(client, IoRead(1, items)).items) == 122


def test_clock_wraps_before_its_overflow(harness, client):
    """A request wraps it between two publications, which continue."""
    machine = harness.controller.program.machine
    machine.world.timers[58] = machine.time - 1_999_999.9
    ask(client, IoSubscribe(8, (IoSpan(DI, 0, 1),)))
    harness.step(0.2)
    result = ask(client, IoRead(5, (IoAddress(DI, 1),)))
    assert 0 <= result.timestamp < 1000
    harness.step(1.0)
    assert client.packets()
