# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The I/O port: requests, publications and lost clients."""

import re
import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.profiles.io_profile import IoProfile
from epson_driver.sim_controller.clock import Clock
from epson_driver.sim_controller.io.io_points import IoPoints
from epson_driver.sim_controller.io.io_session import MAX_RANGES, IoSession
from epson_driver.simple_message import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    Dialect,
    FrameError,
    IoType,
)

INFO, READ, WRITE, RESET, SUB, UNSUB, PUB = range(65200, 65207)
DI, DO, AI, AO, GI, GO, FLAG = range(1, 8)
REQUEST, REPLY, TOPIC = 2, 3, 1
SUCCESS, FAILURE = 1, 2

Words = tuple[int, ...]


def frame(msg_type: int, *words: int, comm_type: int = REQUEST, order: str = '<') -> bytes:
    length = 12 + 4 * len(words)
    return struct.pack(f'{order}{4 + len(words)}i', length, msg_type, comm_type, 0, *words)


class Harness:
    """A controller's points on a manual clock, and its clients."""

    def __init__(self, profile: IoProfile | None = None) -> None:
        self.points = IoPoints(profile or IoProfile())
        self.clock = Clock()
        self.reason: str | None = None

    def client(self, dialect: Dialect = LITTLE_ENDIAN) -> 'Client':
        return Client(self, dialect)

    def wait(self, seconds: float) -> None:
        self.clock.advance(self.clock.now + seconds)


class Client:
    """A client. Each message to it is a tuple: msg_type, comm_type, reply_code, body."""

    def __init__(self, harness: Harness, dialect: Dialect) -> None:
        self.order = dialect.byte_order.value
        self._received = bytearray()
        self.session = IoSession(
            harness.points, dialect, harness.clock, self._received.extend, lambda: harness.reason
        )

    def received(self) -> list[tuple[int, int, int, Words]]:
        data = bytes(self._received)
        self._received.clear()
        messages = []
        while data:
            length, *header = struct.unpack_from(self.order + '4i', data)
            words = struct.unpack(f'{self.order}{(length - 12) // 4}i', data[16 : 4 + length])
            messages.append((*header, words))
            data = data[4 + length :]
        return messages

    def ask(self, msg_type: int, *words: int) -> Words:
        """Return the body of the one reply, which must be a SUCCESS."""
        self.session.receive(frame(msg_type, *words, order=self.order))
        ((replied, comm_type, code, body),) = self.received()
        assert (replied, comm_type, code) == (msg_type, REPLY, SUCCESS)
        return body

    def published(self) -> list[Words]:
        """Return the publications since the last call, and assert that no other message came."""
        messages = self.received()
        assert {message[:3] for message in messages} <= {(PUB, TOPIC, 0)}
        return [message[3] for message in messages]


@pytest.fixture
def harness() -> Harness:
    return Harness()


@pytest.fixture
def client(harness: Harness) -> Client:
    return harness.client()


def test_info_lists_all_ranges(client: Client) -> None:
    ranges = (
        (1, 0, 24, 2), (2, 0, 16, 3), (3, 0, 2, 2), (4, 0, 2, 3),
        (5, 0, 3, 2), (5, 1000, 2, 2), (6, 0, 2, 3), (6, 1000, 1, 3), (7, 0, 512, 3),
    )  # fmt: skip
    words = [word for item in ranges for word in item]
    assert client.ask(INFO, 77) == (77, 1, 9, *words)


def test_read_answers_each_item(harness: Harness, client: Client) -> None:
    harness.points.set_input(IoType.GROUP_INPUT, 0, 0b100)
    harness.points.set_input(IoType.ANALOG_INPUT, 1, -1234)
    harness.wait(1.5)
    items = (DI, 2, AI, 1, GI, 0, DI, 24, 9, 0, DI, -1)
    assert client.ask(READ, 5, 6, *items) == (
        5, 1500, 6,
        DI, 2, 1, 1,
        AI, 1, 1, -1234,
        GI, 0, 1, 4,
        DI, 24, 2001, 0,
        9, 0, 1001, 0,
        DI, -1, 2001, 0,
    )  # fmt: skip


def test_analogue_output_has_a_range(harness: Harness, client: Client) -> None:
    assert client.ask(WRITE, 6, 2, AO, 0, 10_001, AO, 1, 7) == (6, 0, 2, AO, 0, 2002, AO, 1, 1)
    assert [harness.points.read(AO, index) for index in (0, 1)] == [0, 7]


def test_big_endian_controller_answers_io_requests() -> None:
    client = Harness().client(BIG_ENDIAN)
    assert client.ask(WRITE, 1, 1, DO, 3, 1) == (1, 0, 1, DO, 3, 1)


PROFILE = IoProfile(
    safe={(IoType.DIGITAL_OUTPUT, 3): 1},
    keep_on_reset=frozenset({(IoType.DIGITAL_OUTPUT, 0)}),
    keep_on_link_loss=frozenset({(IoType.DIGITAL_OUTPUT, 1)}),
)


def test_reset_sets_safe_values() -> None:
    harness = Harness(PROFILE)
    client = harness.client()
    client.ask(WRITE, 0, 3, GO, 1000, 0xFFF7, AO, 1, 500, FLAG, 9, 1)
    assert client.ask(RESET, 4, 4, DO, 0, DO, 3, DI, 0, DO, 16) == (
        4, 4, DO, 0, 1, DO, 3, 1, DI, 0, 1002, DO, 16, 2001,
    )  # fmt: skip
    assert harness.points.read(GO, 1000) == 0xFFFE
    assert client.ask(RESET, 4, 1, GO, 1) == (4, 1, GO, 1, 1)
    assert harness.points.read(GO, 1000) == 0x00FE
    assert client.ask(RESET, 4, 1, DO, -1) == (4, 1, DO, -1, 1)
    assert harness.points.read(GO, 1000) == 0x0008
    assert (harness.points.read(AO, 1), harness.points.read(FLAG, 9)) == (500, 1)
    assert client.ask(RESET, 4, 1, -1, -1) == (4, 1, -1, -1, 1)
    assert (harness.points.read(AO, 1), harness.points.read(FLAG, 9)) == (0, 0)


def test_repeated_resets_of_all_points_are_done_once(
    harness: Harness, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    reset_point = harness.points.reset_point

    def counted(io_type: int, index: int) -> None:
        calls.append((io_type, index))
        reset_point(io_type, index)

    monkeypatch.setattr(harness.points, 'reset_point', counted)
    body = client.ask(RESET, 0, 1024, *(-1, -1) * 1024)
    assert body == (0, 1024, *(-1, -1, 1) * 1024)
    assert len(calls) == 16 + 2 + 512


def test_examples_of_the_docs_match_the_port(harness: Harness) -> None:
    text = (Path(__file__).parents[3] / 'docs' / 'examples' / 'io_frames.txt').read_text(
        encoding='utf-8'
    )
    text = re.sub(r'\n    (?=[0-9a-f]{8} )', ' ', text)  # long frames continue in the next line
    lines = re.findall(r'^(?:[0-9a-f]{8} {1,2})+[0-9a-f]{8}$', text, re.MULTILINE)
    frames = [bytes.fromhex(line) for line in lines]
    assert len(frames) == 13
    sent: list[bytes] = []
    session = IoSession(
        harness.points, LITTLE_ENDIAN, harness.clock, sent.append, lambda: harness.reason
    )
    harness.points.set_input(IoType.DIGITAL_INPUT, 3, 1)
    session.receive(frames[0])
    sent.clear()  # too long for an example
    times = {1: 1.5, 3: 1.6, 7: 1.7}
    for at, example in enumerate(frames[1:-1], 1):
        harness.clock.advance(times.get(at, harness.clock.now))
        if example[8:12] == struct.pack('<i', REQUEST):
            session.receive(example)
        else:
            assert sent.pop(0) == example
    harness.reason = 'stopped'
    session.receive(frames[3])
    assert sent == [frames[-1]]


# Publications.


def test_subscription_publishes_immediately_and_periodically(
    harness: Harness, client: Client
) -> None:
    harness.points.set_input(IoType.DIGITAL_INPUT, 5, 1)
    assert client.ask(SUB, 9, 2, DI, 4, 3, AI, 0, 1) == (9, 2, DI, 4, 1, AI, 0, 1)
    harness.wait(0.0)
    body = (2, DI, 4, 3, 0, 1, 0, AI, 0, 1, 0)
    assert client.published() == [(0, *body)]
    harness.wait(0.35)
    assert client.published() == [(100, *body), (200, *body), (300, *body)]


def test_change_is_published_immediately(harness: Harness, client: Client) -> None:
    client.ask(SUB, 0, 2, DI, 0, 2, GI, 0, 1)
    harness.wait(0.03)
    client.received()
    harness.points.set_input(IoType.DIGITAL_INPUT, 1, 1)
    harness.points.set_input(IoType.DIGITAL_INPUT, 0, 1)
    harness.wait(0.0)
    assert client.published() == [(30, 2, DI, 0, 2, 1, 1, GI, 0, 1, 3)]
    harness.wait(0.05)
    assert client.published() == []


def test_changes_are_published_no_closer_than_the_interval(
    harness: Harness, client: Client
) -> None:
    client.ask(SUB, 0, 1, DI, 0, 1)
    harness.wait(0.0)
    client.received()
    stamps = []
    for step in range(90):
        harness.points.set_input(IoType.DIGITAL_INPUT, 0, step % 2)
        harness.wait(0.001)
        stamps += [body[0] for body in client.published()]
    assert stamps == list(range(10, 91, 10))


def test_undone_change_is_not_published(harness: Harness, client: Client) -> None:
    client.ask(SUB, 0, 1, DI, 0, 1)
    harness.wait(0.05)
    client.received()
    harness.points.set_input(IoType.DIGITAL_INPUT, 0, 1)
    harness.points.set_input(IoType.DIGITAL_INPUT, 0, 0)
    harness.points.set_input(IoType.DIGITAL_INPUT, 7, 1)  # not subscribed
    harness.wait(0.01)
    assert client.published() == []


def test_unsubscribed_range_is_not_published(harness: Harness, client: Client) -> None:
    client.ask(SUB, 0, 2, DI, 0, 1, DO, 0, 1)
    harness.wait(0.0)
    client.received()
    assert client.ask(UNSUB, 2, 4, DI, 0, DI, 1, DI, 24, 8, 0) == (
        2, 4, DI, 0, 1, DI, 1, 2003, DI, 24, 2001, 8, 0, 1001,
    )  # fmt: skip
    harness.wait(0.1)
    assert client.published() == [(100, 1, DO, 0, 1, 0)]
    assert client.ask(UNSUB, 2, 1, DO, 0) == (2, 1, DO, 0, 1)
    harness.points.write(DO, 0, 1)
    harness.wait(1.0)
    assert client.published() == []
    assert harness.clock.next_due is None
    client.ask(SUB, 0, 1, DO, 0, 1)
    harness.wait(0.1)
    assert client.published() == [(1100, 1, DO, 0, 1, 1), (1200, 1, DO, 0, 1, 1)]


def test_the_number_of_ranges_is_bounded(harness: Harness, client: Client) -> None:
    items = [word for start in range(MAX_RANGES + 1) for word in (FLAG, start, 1)]
    body = client.ask(SUB, 0, MAX_RANGES + 1, *items)
    assert body[4::3] == (1,) * MAX_RANGES + (65001,)
    harness.wait(0.0)
    ((_, count, *_),) = client.published()
    assert count == MAX_RANGES


def test_the_number_of_values_is_bounded(harness: Harness) -> None:
    client = Harness(IoProfile(flags=4096)).client()
    assert client.ask(SUB, 0, 3, FLAG, 0, 4096, FLAG, 1, 1, DI, 0, 1) == (
        0, 3, FLAG, 0, 1, FLAG, 1, 65001, DI, 0, 65001,
    )  # fmt: skip


# A stopped I/O server.


def test_without_the_io_server_every_request_fails_and_nothing_is_published(
    harness: Harness, client: Client
) -> None:
    client.ask(SUB, 0, 1, DO, 0, 1)
    harness.wait(0.0)
    client.received()
    harness.reason = 'the E-stop aborted the I/O server'
    for msg_type, words in (
        (INFO, (1,)),
        (READ, (1, 1, DI, 0)),
        (WRITE, (1, 1, DO, 0, 1)),
        (RESET, (1, 1, -1, -1)),
        (SUB, (1, 1, DI, 0, 1)),
        (UNSUB, (1, 1, DO, 0)),
    ):
        client.session.receive(frame(msg_type, *words))
        assert client.received() == [(msg_type, REPLY, FAILURE, ())]
    assert harness.points.read(DO, 0) == 0
    harness.points.write(DO, 0, 1)
    harness.wait(0.45)
    assert client.received() == []
    harness.reason = None
    harness.wait(0.1)
    assert client.published() == [(500, 1, DO, 0, 1, 1)]


# Other frames.


def test_request_with_too_many_items_fails_as_a_whole(harness: Harness, client: Client) -> None:
    client.session.receive(frame(WRITE, 0, 1025, *(DO, 0, 1) * 1025))
    assert client.received() == [(WRITE, REPLY, FAILURE, ())]
    assert harness.points.read(GO, 1000) == 0


def test_impossible_length_ends_the_session(client: Client) -> None:
    with pytest.raises(FrameError, match='length = 65536'):
        client.session.receive(struct.pack('<i', 65536))


@pytest.mark.invariant(7)
@settings(max_examples=examples(200))
@given(
    msg_type=st.integers(65199, 65207),
    comm_type=st.sampled_from([REQUEST, REQUEST, TOPIC, REPLY, 0]),
    words=st.lists(st.integers(-2, 9) | st.integers(-(2**31), 2**31 - 1), max_size=14),
)
def test_inv7_next_request_works_after_any_words(
    msg_type: int, comm_type: int, words: list[int]
) -> None:
    harness = Harness()
    client = harness.client()
    client.session.receive(frame(msg_type, *words, comm_type=comm_type))
    assert len(client.received()) <= 1
    harness.wait(0.0)
    client.received()
    assert client.ask(READ, 1, 1, DI, 0) == (1, 0, 1, DI, 0, 1, 0)


# A lost client.


def test_lost_client_gets_no_messages(harness: Harness, client: Client) -> None:
    client.ask(SUB, 0, 1, DI, 0, 1)
    harness.wait(0.0)
    client.received()
    harness.points.set_input(IoType.DIGITAL_INPUT, 0, 1)
    client.session.closed()
    client.session.closed()
    harness.points.set_input(IoType.DIGITAL_INPUT, 0, 0)
    harness.wait(1.0)
    client.session.receive(frame(READ, 0, 1, DI, 0))
    assert client.received() == []
    assert harness.clock.next_due is None
