# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Rules of the I/O port (docs/io.md) that the built-in server and the SPEL+ program share.

The last tests are of the SPEL+ program only.
"""

import struct
from dataclasses import replace
from itertools import chain

import pytest
from support.controller_harness import MODEL, PROFILE, frame
from support.spel_program_harness import (
    OUR_FILES,
    SPEL_PROFILE,
    OurProgramHarness,
    ProgramClient,
    SpelProgramHarness,
)

from epson_driver.sim_controller.assembly import new_controller

INFO, READ, WRITE, RESET, SUB, UNSUB, PUB = range(65200, 65207)
TOPIC, REQUEST, REPLY = 1, 2, 3
DI, DO, AI, AO, GI, GO, FLAG = range(1, 8)
DONE, NO_TYPE, READ_ONLY, NO_INDEX, NO_VALUE, NO_RANGE, TOO_MUCH = (
    1, 1001, 1002, 2001, 2002, 2003, 65001,
)  # fmt: skip
ID = 77
BUILT_IN = replace(PROFILE, io=replace(SPEL_PROFILE.io, flags=64))
"""A profile with the points that the SPEL+ program serves."""


class BuiltIn(SpelProgramHarness):
    """A controller with the built-in programs."""

    def __init__(self):
        self._start(new_controller(MODEL, BUILT_IN), None)


def message(msg_type, *words, comm_type=REQUEST, code=0):
    return frame(msg_type, comm_type, code, struct.pack(f'<{len(words)}i', *words))


class IoClient(ProgramClient):
    """A client that sends and receives words."""

    def received(self, msg_type):
        """Return the bodies of the messages of a type since the last call."""
        bodies = [frame.body for frame in self.frames() if frame.msg_type == msg_type]
        return [struct.unpack(f'<{len(body) // 4}i', body) for body in bodies]

    def ask(self, msg_type, *items):
        """Return the result of each item of a request, with its value if it reads."""
        self.raw()
        self.send_bytes(message(msg_type, ID, len(items), *chain(*items)))
        answers = []
        self.harness.until(lambda: answers.extend(self.received(msg_type)) or answers)
        ((number, *words),) = answers
        if msg_type in (READ, WRITE):
            assert 0 < words.pop(0) <= self.harness.now * 1000
        assert (number, words[0]) == (ID, len(items))
        rows = list(zip(*[iter(words[1:])] * (4 if msg_type == READ else 3), strict=True))
        assert [row[:2] for row in rows] == [item[:2] for item in items]
        return [row[2:] if msg_type == READ else row[2] for row in rows]

    def on(self, io_type, count=16):
        """Return the points of a type that are 1."""
        return {n for n in range(count) if self.harness.controller.io.read(io_type, n)}


def connected(harness):
    return IoClient.connect(harness, 'io')


@pytest.fixture(params=[BuiltIn, OurProgramHarness])
def client(request):
    return connected(request.param())


@pytest.fixture
def points(client):
    """The points of the controller."""
    return client.harness.controller.io


def test_info_lists_the_ranges(client):
    words = 1 + isinstance(client.harness, BuiltIn)  # the last half of one
    ranges = (
        (DI, 0, 24, 2), (DO, 0, 16, 3), (GI, 0, 3, 2), (GI, 1000, words, 2), (GO, 0, 2, 3),
        (GO, 1000, 1, 3), (FLAG, 0, 64, 3),
    )  # fmt: skip
    client.raw()
    client.send_bytes(message(INFO, ID))
    client.harness.step(0.1)
    assert client.received(INFO) == [(ID, 1, 7, *chain(*ranges))]


def test_read_answers_each_item(client, points):
    for index in (1, 9, 15):
        points.set_input(DI, index, 1)
    points.write(DO, 3, 1)
    points.write(FLAG, 63, 1)
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
        (GI, 1002): (NO_INDEX, 0),
        (FLAG, 500): (NO_INDEX, 0),
        (FLAG, 1000): (NO_INDEX, 0),
        (DO, 2**31 - 1): (NO_INDEX, 0),
        (DO, 1000): (NO_INDEX, 0),
    }
    assert client.ask(READ, *expected) == list(expected.values())


def test_write_executes_valid_items_and_answers_each(client):
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
    assert client.ask(WRITE, *expected) == list(expected.values())
    assert client.on(DO) == {7, 15}
    assert client.on(FLAG, 64) == {5}
    client.ask(WRITE, (GO, 1000, 0xC003))
    assert client.on(DO) == {0, 1, 14, 15}


def test_reset_clears_outputs(client):
    for item, outputs, flags in (
        ((DO, 3), {4, 12}, {3}),
        ((GO, 1), {3, 4}, {3}),
        ((FLAG, 3), {3, 4, 12}, set()),
        ((DO, -1), set(), {3}),
        ((GO, -1), set(), {3}),
        ((FLAG, -1), {3, 4, 12}, set()),
        ((-1, -1), set(), set()),
    ):
        client.ask(WRITE, (DO, 3, 1), (DO, 4, 1), (DO, 12, 1), (FLAG, 3, 1))
        assert client.ask(RESET, item) == [DONE]
        assert client.on(DO) == outputs
        assert client.on(FLAG, 64) == flags
    results = client.ask(RESET, (DI, 0), (DI, -1), (99, -1), (-1, 0), (DO, 99))
    assert results == [READ_ONLY, READ_ONLY, NO_TYPE, NO_TYPE, NO_INDEX]


@pytest.mark.parametrize('msg_type', [READ, WRITE, RESET, SUB, UNSUB])
def test_empty_request_gets_an_empty_answer(client, msg_type):
    assert client.ask(msg_type) == []


def test_publications_on_change_and_periodically(client, points):
    assert client.ask(SUB, (DI, 0, 3), (GO, 0, 2), (FLAG, 0, 64)) == [DONE] * 3
    client.harness.step(0.3)
    rest = (GO, 0, 2, 0, 0, FLAG, 0, 64, *[0] * 64)
    assert client.received(PUB)[0][1:] == (3, DI, 0, 3, 0, 0, 0, *rest)
    client.harness.step(2.0)
    assert 3 <= len(client.received(PUB)) <= 6
    points.set_input(DI, 1, 1)
    client.harness.step(0.15)
    assert client.received(PUB)[0][1:] == (3, DI, 0, 3, 0, 1, 0, *rest)
    results = client.ask(UNSUB, (DI, 0), (DO, 0), (GO, 0), (FLAG, 0))
    assert results == [DONE, NO_RANGE, DONE, DONE]
    client.raw()
    client.harness.step(2.0)
    assert client.raw() == b''


def test_subscription_to_a_missing_range_is_an_error(client):
    results = client.ask(SUB, (DI, 20, 5), (99, 0, 1), (DI, 0, 0), (GI, 2, 999))
    assert results == [NO_INDEX, NO_TYPE, NO_INDEX, NO_INDEX]
    client.harness.step(1.0)
    assert client.raw() == b''


@pytest.mark.parametrize(
    ('msg_type', 'item', 'left'),
    [
        (WRITE, (DO, 3, 1), set()),
        (RESET, (DO, 5), set()),
        (WRITE, (FLAG, 3, 1), {0}),
        (WRITE, (DO, 16, 1), {0}),
        (RESET, (DI, 0), {0}),
        (READ, (DO, 0), {0}),
    ],
)
def test_lost_client_resets_outputs_if_it_wrote_one(client, points, msg_type, item, left):
    points.write(DO, 0, 1)
    client.ask(msg_type, item)
    client.leave()
    client.harness.step(0.5)
    assert client.on(DO) == left
    assert client.on(FLAG, 64) == ({3} if item == (FLAG, 3, 1) else set())


def test_long_reply_is_complete(client):
    """122 items have 1,976 bytes, and WriteBin of SPEL+ accepts 1,023."""
    assert client.ask(READ, *((DI, n % 24) for n in range(122))) == [(DONE, 0)] * 122


@pytest.mark.parametrize(
    ('sent', 'answer'),
    [
        (message(1), message(1, comm_type=REPLY, code=1)),
        (message(1, *[0] * 10), message(1, *[0] * 10, comm_type=REPLY, code=1)),
        (message(2), message(2, 0, 2, 0, comm_type=REPLY, code=1)),
        *(
            (message(*words), message(words[0], comm_type=REPLY, code=2))
            for words in (
                (13, *[0] * 7),
                (1500, 1, 2, 3),
                (65207, 0, 0),
                (PUB, 0, 0),
                (INFO, 5, 5),
                (READ,),
                (READ, 5),
                (READ, 5, 5),
                (READ, 0, 2, DI, 0),
                (READ, 0, -1),
                (WRITE, 0, 2**31 - 1, DO, 0, 1),
            )
        ),
        (message(WRITE, 0, 1, DO, 0, 1, comm_type=TOPIC), b''),
        (message(WRITE, 0, 1, DO, 0, 1, comm_type=REPLY, code=1), b''),
        (message(WRITE, 0, 1, DO, 0, 1, comm_type=9), message(WRITE, comm_type=REPLY, code=2)),
    ],
    ids=lambda data: data[4:].hex(),
)
def test_message_that_is_no_io_request_changes_nothing(client, sent, answer):
    client.send_bytes(sent)
    client.harness.step(0.1)
    assert client.raw() == answer
    assert client.on(DO) == set()
    assert client.ask(WRITE, (DO, 0, 1)) == [DONE]


# ---- the SPEL+ program only


def test_stop_bit_cannot_be_written():
    client = connected(OurProgramHarness())
    assert client.ask(WRITE, (FLAG, 500, 1), (FLAG, 64, 1)) == [NO_INDEX, NO_INDEX]


def test_largest_subscription_is_published():
    client = connected(OurProgramHarness())
    flags = [(FLAG, n, 64 - n) for n in range(5)]
    assert client.ask(SUB, *flags, (FLAG, 0, 1)) == [DONE] * 4 + [TOO_MUCH, DONE]
    inputs = [(DI, n, 1) for n in range(5)]
    assert client.ask(SUB, *inputs, (DI, 0, 25)) == [DONE] * 4 + [TOO_MUCH, NO_INDEX]
    client.raw()
    client.harness.step(1.0)
    assert client.received(PUB)[0][1] == 8


def test_config_may_keep_the_outputs():
    client = connected(OurProgramHarness(IO_OFF_WHEN_LOST=''))
    client.ask(WRITE, (DO, 3, 1))
    client.leave()
    client.harness.step(0.5)
    assert client.on(DO) == {3}


def test_remote_outputs_of_rc_plus_are_read_only():
    """The shipped configuration reserves bits 0 to 7, their byte and their word."""
    assert '\n#define IO_FIRST_OUTPUT_BYTE 1\n' in OUR_FILES['config.inc']
    client = connected(OurProgramHarness(IO_FIRST_OUTPUT_BYTE='1'))
    results = client.ask(WRITE, (DO, 7, 1), (DO, 8, 1), (GO, 0, 1), (GO, 1000, 1))
    assert results == [READ_ONLY, DONE, READ_ONLY, READ_ONLY]
    client.harness.controller.io.write(DO, 2, 1)
    client.ask(RESET, (DO, -1))
    assert client.on(DO) == {2}


@pytest.mark.parametrize('event', ['E-stop press', 'door open'])
def test_outputs_are_written_in_an_estop_and_with_an_open_door(event):
    """SPEL+ reference, p. 560, p. 567: it needs Forced. The interpreter checks that."""
    client = connected(OurProgramHarness())
    client.harness.do(event)
    assert client.ask(WRITE, (DO, 3, 1), (GO, 1, 5), (GO, 1000, 0x0108)) == [DONE] * 3
    client.leave()
    client.harness.step(0.5)
    assert client.on(DO) == set()


def test_clock_wraps_before_its_overflow():
    """A request wraps it between two publications, which continue."""
    client = connected(OurProgramHarness())
    machine = client.harness.controller.program.machine
    machine.world.timers[58] = machine.time - 1_999_999.9
    client.raw()
    client.send_bytes(message(SUB, ID, 1, DI, 0, 1))
    client.harness.step(0.2)
    client.send_bytes(message(READ, ID, 1, DI, 0))
    client.harness.step(0.05)
    ((_, stamp, *_),) = client.received(READ)
    assert 0 <= stamp < 1000
    client.harness.step(1.0)
    assert client.received(PUB)
