# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Faults of connections on one transport: output, timing and end."""

import struct
from itertools import pairwise

import pytest
from support.fault_harness import FaultHarness, answer, ask, state

from epson_driver.sim_controller.faults.disturbances import (
    byte_order,
    is_reply,
)
from epson_driver.sim_controller.faults.fault_kinds import FAULTS
from epson_driver.sim_controller.faults.faults import MAX_DELAYED_BYTES
from epson_driver.simple_message import BIG_ENDIAN, ByteOrder, FrameError, Framer

LINK_FAULTS = [name for name, kind in FAULTS.items() if kind.ports]
LINE = b'#GetStatus,00100000001,0000\r\n'


@pytest.fixture
def harness():
    return FaultHarness()


def assert_normal(harness, client):
    """Assert that messages in both directions pass unchanged."""
    client.taken()
    assert harness.faults.active() == []
    sent = [state(900), answer(901), state(902)]
    client.send(*sent)
    assert client.taken() == sent
    assert client.transport.receive(ask(3)) == ask(3)
    assert client.transport.delayed_bytes == 0
    assert client.hung_up == 0


def bits_changed(before, after):
    assert len(before) == len(after)
    return sum((a ^ b).bit_count() for a, b in zip(before, after, strict=True))


def test_without_a_fault_messages_pass_unchanged(harness):
    client = harness.client()
    client.send(state(1), answer(2), b'', LINE)
    assert client.taken() == [state(1), answer(2), b'', LINE]
    assert client.transport.receive(b'any') == b'any'
    assert harness.clock.next_due is None


def test_cut_closes_connections_and_refuses_new_ones(harness):
    clients = {port: harness.client(port) for port in ('motion', 'state', 'io', 'remote')}
    harness.start('cut:for=2,port=motion+io')
    assert {port: item.hung_up for port, item in clients.items()} == {
        'motion': 1,
        'state': 0,
        'io': 1,
        'remote': 0,
    }
    clients['motion'].send(state(1))
    assert clients['motion'].taken() == []
    assert clients['motion'].transport.receive(ask(1)) == b''
    assert harness.faults.rejects('motion')
    assert not harness.faults.rejects('state')
    harness.wait(1.999)
    assert harness.faults.rejects('io')
    harness.wait(0.001)
    assert not harness.faults.rejects('motion')
    assert not harness.faults.rejects('io')
    assert_normal(harness, harness.client('motion'))
    assert clients['motion'].hung_up == 1


def test_cut_lasts_until_cleared(harness):
    harness.start('cut:for=0')
    harness.wait(3600.0)
    assert harness.faults.rejects('state')
    assert not harness.faults.rejects('remote')
    harness.clear('cut')
    assert not harness.faults.rejects('state')


def test_half_open_is_silent_but_stays_connected(harness):
    client = harness.client('state')
    harness.start('half_open:for=3')
    harness.stream(client, 100)
    assert client.taken() == []
    harness.wait(3.0)
    assert client.taken() == []  # lost, not late
    assert_normal(harness, client)


def test_half_open_closes_connections_that_lost_bytes(harness):
    lossy, intact = harness.client('motion'), harness.client('motion')
    harness.start('half_open')
    assert lossy.transport.receive(ask(1)) == b''
    assert lossy.transport.receive(ask(2)[:10]) == b''
    harness.wait(100.0)
    assert (lossy.hung_up, intact.hung_up) == (0, 0)
    harness.clear('half_open')
    assert (lossy.hung_up, intact.hung_up) == (1, 0)
    assert lossy.transport.receive(ask(2)[10:]) == b''
    assert_normal(harness, intact)


def test_delay_is_constant_and_ends(harness):
    client = harness.client()
    harness.start('delay:seconds=0.02,for=0.01')
    messages = harness.stream(client, 5)
    harness.wait(1.0)
    assert client.times() == [20, 25, 25, 25, 25]  # two are late and the others keep the order
    assert_normal(harness, client)
    harness.stream(client, 1)
    assert client.taken() == messages[:1]


def test_clearing_delay_sends_the_delayed_messages(harness):
    client = harness.client()
    harness.start('delay 5')
    messages = harness.stream(client, 10)
    assert client.taken() == []
    assert client.transport.delayed_bytes == sum(map(len, messages))
    harness.clear('delay')
    assert client.taken() == messages
    assert_normal(harness, client)
    harness.wait(10.0)
    assert client.taken() == []


def test_jitter_is_random_bounded_and_in_order(harness):
    client = harness.client()
    harness.start('jitter:seconds=0.03')
    messages = harness.stream(client, 200)
    harness.wait(0.03)
    late = [
        time - 0.005 * number
        for number, (time, data) in enumerate(client.segments)
        if data == messages[number]
    ]
    assert len(late) == 200
    assert all(0.0 <= item <= 0.03 + 1e-9 for item in late)
    assert len({round(item, 6) for item in late}) > 20
    harness.clear('jitter')
    assert_normal(harness, client)


def test_coalesce_joins_messages_within_its_time(harness):
    client = harness.client()
    harness.start('coalesce:seconds=0.017')
    messages = harness.stream(client, 8)
    assert [data for _, data in client.segments] == [
        b''.join(messages[:4]),
        b''.join(messages[4:]),
    ]
    assert client.times() == [17, 37]
    harness.clear('coalesce')
    assert_normal(harness, client)


def test_one_byte_sends_single_bytes(harness):
    client = harness.client()
    harness.start('one_byte:for=1')
    client.send(state(1), state(2))
    assert client.taken() == [bytes([byte]) for byte in state(1) + state(2)]
    harness.wait(1.0)
    assert_normal(harness, client)


def test_bit_errors_flip_bits_at_the_given_rate(harness):
    client = harness.client()
    harness.start('bit_errors:rate=0.25,bits=3')
    messages = harness.stream(client, 1000)
    changed = [bits_changed(*pair) for pair in zip(messages, client.taken(), strict=True)]
    assert set(changed) == {0, 3}
    assert 200 < changed.count(3) < 300
    harness.clear('bit_errors')
    assert_normal(harness, client)


def test_wrong_length_changes_one_message(harness):
    client = harness.client()
    harness.start('wrong_length:skip=2')
    messages = harness.stream(client, 4)
    taken = client.taken()
    assert taken[2] == struct.pack('<i', 60) + messages[2][4:]
    assert [taken[0], taken[1], taken[3]] == [messages[0], messages[1], messages[3]]
    assert_normal(harness, client)


@pytest.mark.parametrize('dialect_order', ByteOrder)
@pytest.mark.parametrize('value', [-1, 0, 11, 70_000, 2**31 - 1])
def test_wrong_length_of_any_value_is_refused_by_a_framer(harness, value, dialect_order):
    client = harness.client()
    harness.start(f'wrong_length:value={value}')
    message = state(1, BIG_ENDIAN) if dialect_order is ByteOrder.BIG else state(1)
    client.send(message)
    (data,) = client.taken()
    assert data == struct.pack(dialect_order.value + 'i', value) + message[4:]
    framer = Framer(dialect_order)
    framer.receive_data(data)
    with pytest.raises(FrameError, match='length'):
        framer.next_frame()


def test_lost_reply_drops_the_given_number_of_replies(harness):
    client = harness.client('motion')
    harness.start('lost_reply:count=2,skip=1')
    client.send(*(answer(0), state(0), answer(1), state(1), answer(2), answer(3)))
    assert client.taken() == [answer(0), state(0), state(1), answer(3)]
    assert client.transport.receive(ask(1)) == ask(1)
    assert_normal(harness, client)


def test_late_reply_delays_one_reply_and_keeps_the_order(harness):
    client = harness.client('motion')
    harness.start('late_reply:seconds=0.5')
    client.send(state(0), answer(0), answer(1))
    assert client.taken() == [state(0)]
    assert harness.faults.active() == []
    harness.wait(0.4)
    client.send(answer(2))
    assert client.taken() == []
    harness.wait(0.1)
    assert client.taken() == [answer(0), answer(1), answer(2)]
    assert_normal(harness, client)


def test_wrong_byte_order_swaps_every_word(harness):
    client = harness.client()
    harness.start('wrong_byte_order')
    client.send(state(7), answer(8), state(9, BIG_ENDIAN), b'12345')
    expected = [state(7, BIG_ENDIAN), answer(8, BIG_ENDIAN), state(9), b'43215']
    assert client.taken() == expected
    framer = Framer(ByteOrder.LITTLE)
    framer.receive_data(expected[0])
    with pytest.raises(FrameError, match='byte order'):
        framer.next_frame()
    harness.clear('wrong_byte_order')
    assert_normal(harness, client)


@pytest.mark.parametrize('name', LINK_FAULTS)
def test_fault_does_not_disturb_other_ports(harness, name):
    untouched = harness.client('io')
    harness.start(f'{name}:port=state')
    sent = [answer(number) for number in range(20)]
    untouched.send(*sent)
    assert untouched.taken() == sent
    assert untouched.transport.receive(ask(1)) == ask(1)
    assert untouched.hung_up == 0


@pytest.mark.parametrize('name', LINK_FAULTS)
def test_received_bytes_are_never_changed(harness, name):
    """No fault can cause motion. A session receives the sent bytes or nothing."""
    client = harness.client('motion')
    harness.start(f'{name}:port=motion')
    for number in range(20):
        client.send(answer(number))
        assert client.transport.receive(ask(number)) in (ask(number), b'')
        harness.wait(0.01)


@pytest.mark.parametrize('name', LINK_FAULTS)
def test_cleared_faults_have_no_further_effect(harness, name):
    client = harness.client('motion')
    harness.start(f'{name}:port=motion')
    harness.wait(0.5)
    client.send(state(1), answer(2), state(3))
    harness.clear()
    again = harness.client('motion') if client.hung_up else client
    assert_normal(harness, again)
    harness.wait(100.0)
    assert again.taken() == []
    assert harness.clock.next_due is None


@pytest.mark.parametrize('name', [name for name in LINK_FAULTS if name != 'cut'])
def test_fault_starts_after_its_delay_and_ends_on_time(harness, name):
    client = harness.client('motion')
    counts = any(parameter.name == 'count' for parameter in FAULTS[name].parameters)
    unlimited = ',count=0' if counts else ''
    late = ',seconds=0.05' if name == 'late_reply' else ''  # the next messages are not held
    harness.start(f'{name}:port=motion,after=2,for=1{unlimited}{late}')
    for when, disturbed in ((0.0, False), (1.9, False), (2.1, True), (2.9, True), (3.1, False)):
        harness.wait(when - harness.clock.now)
        client.taken()
        sent = [answer(number) for number in range(30)]
        client.send(*sent)
        assert (client.taken() != sent) is disturbed, when
        if disturbed:
            harness.wait(0.06)
    assert harness.faults.active() == []


def test_faults_combine_in_their_order_of_start(harness):
    client = harness.client()
    for text in ('delay:seconds=0.1', 'delay:seconds=0.2', 'one_byte', 'wrong_length:add=1'):
        harness.start(text)
    client.send(state(1))
    harness.wait(0.299)
    assert client.taken() == []
    harness.wait(0.002)
    assert client.taken() == [bytes([byte]) for byte in struct.pack('<i', 57) + state(1)[4:]]
    harness.start('coalesce:seconds=0.1')
    client.send(state(1), state(2))
    harness.wait(0.301)
    assert client.taken() == []
    harness.wait(0.1)
    assert b''.join(client.taken()) == state(1) + state(2)


@pytest.mark.parametrize(
    'text', ['jitter:seconds=0.2', 'jitter coalesce', 'coalesce late_reply', 'jitter late_reply']
)
def test_faults_keep_the_order_of_messages_without_duplicates(harness, text):
    client = harness.client('motion')
    for fault in text.split():
        harness.start(fault)
    sent = []
    for number in range(400):
        message = answer(number) if number % 7 == 0 else state(number)
        sent.append(message)
        client.send(message)
        harness.wait(0.004)
        if number == 200:
            harness.clear()
            assert client.transport.delayed_bytes == 0
            harness.start(text.split()[0])
    harness.wait(5.0)
    times = [time for time, _ in client.segments]
    assert all(before <= after for before, after in pairwise(times))
    assert b''.join(client.taken()) == b''.join(sent)


@pytest.mark.parametrize('text', ['delay:seconds=60', 'coalesce:seconds=10', 'late_reply 60'])
def test_number_of_delayed_bytes_is_limited(harness, text):
    client = harness.client('motion')
    harness.start(text)
    most = 0
    for number in range(10_000):
        client.send(answer(number))
        most = max(most, client.transport.delayed_bytes)
    assert MAX_DELAYED_BYTES - 100 < most <= MAX_DELAYED_BYTES
    assert client.hung_up == 1
    assert client.transport.delayed_bytes == 0
    harness.wait(100.0)
    assert client.taken() == []


def outcome(seed, *texts, before=()):
    """Return the segments that two state clients receive with these faults."""
    harness = FaultHarness(seed)
    for port in before:
        harness.client(port)
    clients = [harness.client('state'), harness.client('state')]
    for text in texts:
        harness.start(text)
    for number in range(300):
        for client in clients:
            client.send(state(number))
        harness.wait(0.005)
    harness.wait(5.0)
    return [client.segments for client in clients]


RANDOM = ('jitter:port=state', 'bit_errors:rate=0.5,bits=4')


def test_same_seed_gives_the_same_bytes_and_times():
    assert outcome(5, *RANDOM) == outcome(5, *RANDOM)


def test_random_faults_depend_on_seed_connection_and_order():
    first, second = outcome(5, *RANDOM)
    assert first != second
    assert first not in outcome(6, *RANDOM)
    assert first not in outcome(5, *reversed(RANDOM))


def test_fault_with_its_own_seed_is_independent():
    alone = outcome(5, 'jitter:seed=3')
    assert outcome(6, 'jitter:seed=3') == alone
    assert outcome(6, 'bit_errors:rate=0', 'jitter:seed=3') == alone
    assert outcome(5, 'jitter:seed=4') != alone


def test_closed_transport_sends_nothing(harness):
    client = harness.client()
    harness.start('delay:seconds=1')
    client.send(state(1))
    client.transport.close()
    client.transport.close()
    assert harness.clock.next_due is None
    client.send(state(2))
    harness.start('cut')
    harness.wait(5.0)
    assert client.taken() == []
    assert client.hung_up == 0
    assert client.transport.receive(b'x') == b''
    assert client.transport.delayed_bytes == 0


@pytest.mark.parametrize(
    ('message', 'order', 'reply'),
    [
        (state(1), ByteOrder.LITTLE, False),
        (answer(1), ByteOrder.LITTLE, True),
        (answer(1, BIG_ENDIAN), ByteOrder.BIG, True),
        (ask(1), ByteOrder.LITTLE, False),
        (answer(1)[:-1], None, False),
        (LINE, None, False),
        (b'', None, False),
        (struct.pack('<ii', 4, 3), ByteOrder.LITTLE, False),
    ],
)
def test_byte_order_and_replies_are_recognized(message, order, reply):
    assert byte_order(message) is order
    assert is_reply(message) is reply
