# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every fault of connections, at one wire: what comes out, when, and that it ends."""

import struct
from itertools import pairwise

import pytest
from fault_bench import FaultBench, answer, ask, state

from epson_driver.controller.faults.disturbances import DISTURBANCES, byte_order, is_reply
from epson_driver.controller.faults.fault_kinds import FAULTS
from epson_driver.controller.faults.wire import MAX_HELD
from epson_driver.simple_message import BIG_ENDIAN, ByteOrder, FrameError, Framer

LINK_FAULTS = [name for name, kind in FAULTS.items() if kind.ports]
LINE = b'#GetStatus,00100000001,0000\r\n'


@pytest.fixture
def bench():
    return FaultBench()


def assert_normal(bench, client):
    """What is sent passes at once and unchanged, and what the client sends too."""
    client.taken()
    assert bench.faults.active() == []
    sent = [state(900), answer(901), state(902)]
    client.send(*sent)
    assert client.taken() == sent
    assert client.wire.receive(ask(3)) == ask(3)
    assert client.wire.held == 0
    assert client.hung_up == 0


def bits_changed(before, after):
    assert len(before) == len(after)
    return sum((a ^ b).bit_count() for a, b in zip(before, after, strict=True))


def test_without_a_fault_everything_passes_at_once(bench):
    client = bench.client()
    client.send(state(1), answer(2), b'', LINE)
    assert client.taken() == [state(1), answer(2), b'', LINE]
    assert client.wire.receive(b'any') == b'any'
    assert bench.clock.next_due is None


def test_byte_by_byte_needs_no_fault(bench):
    client = bench.client(byte_by_byte=True)
    client.send(state(1))
    assert client.taken() == [bytes([byte]) for byte in state(1)]
    bench.start('delay:seconds=0.2')
    client.send(state(2))
    assert client.taken() == []
    bench.wait(0.2)
    assert client.taken() == [bytes([byte]) for byte in state(2)]


def test_cut_closes_the_ports_connections_at_once_and_refuses_new_ones(bench):
    clients = {port: bench.client(port) for port in ('motion', 'state', 'io', 'remote')}
    bench.start('cut:for=2,port=motion+io')
    assert {port: each.hung_up for port, each in clients.items()} == {
        'motion': 1,
        'state': 0,
        'io': 1,
        'remote': 0,
    }
    clients['motion'].send(state(1))
    assert clients['motion'].taken() == []
    assert clients['motion'].wire.receive(ask(1)) == b''
    assert bench.faults.refuses('motion')
    assert not bench.faults.refuses('state')
    bench.wait(1.999)
    assert bench.faults.refuses('io')
    bench.wait(0.001)
    assert not bench.faults.refuses('motion')
    assert not bench.faults.refuses('io')
    assert_normal(bench, bench.client('motion'))
    assert clients['motion'].hung_up == 1


def test_cut_until_cleared(bench):
    bench.start('cut:for=0')
    bench.wait(3600.0)
    assert bench.faults.refuses('state')
    assert not bench.faults.refuses('remote')
    bench.clear('cut')
    assert not bench.faults.refuses('state')


def test_half_open_is_silent_in_both_directions_and_stays_connected(bench):
    client = bench.client('state')
    bench.start('half_open:for=3')
    bench.stream(client, 100)
    assert client.taken() == []
    bench.wait(3.0)
    assert client.taken() == []  # lost, not late
    assert_normal(bench, client)


def test_half_open_hangs_up_afterwards_where_bytes_of_the_client_were_lost(bench):
    heard, unheard = bench.client('motion'), bench.client('motion')
    bench.start('half_open')
    assert heard.wire.receive(ask(1)) == b''
    assert heard.wire.receive(ask(2)[:10]) == b''
    bench.wait(100.0)
    assert (heard.hung_up, unheard.hung_up) == (0, 0)
    bench.clear('half_open')
    assert (heard.hung_up, unheard.hung_up) == (1, 0)
    assert heard.wire.receive(ask(2)[10:]) == b''
    assert_normal(bench, unheard)


def test_half_open_loses_what_was_held(bench):
    client = bench.client()
    bench.start('delay:seconds=1')
    client.send(state(1))
    bench.start('half_open')
    bench.clear()
    bench.wait(2.0)
    assert client.taken() == []
    assert_normal(bench, client)


def test_delay_is_the_same_for_all_and_ends(bench):
    client = bench.client()
    bench.start('delay:seconds=0.02,for=0.01')
    messages = bench.stream(client, 5)
    bench.wait(1.0)
    assert client.times() == [20, 25, 25, 25, 25]  # two are late, the others do not overtake
    assert_normal(bench, client)
    bench.stream(client, 1)
    assert client.taken() == messages[:1]


def test_delay_cleared_sends_what_was_held_at_once(bench):
    client = bench.client()
    bench.start('delay 5')
    messages = bench.stream(client, 10)
    assert client.taken() == []
    assert client.wire.held == sum(map(len, messages))
    bench.clear('delay')
    assert client.taken() == messages
    assert_normal(bench, client)
    bench.wait(10.0)
    assert client.taken() == []


def test_jitter_is_random_bounded_and_in_order(bench):
    client = bench.client()
    bench.start('jitter:seconds=0.03')
    messages = bench.stream(client, 200)
    bench.wait(0.03)
    late = [
        time - 0.005 * number
        for number, (time, data) in enumerate(client.segments)
        if data == messages[number]
    ]
    assert len(late) == 200
    assert all(0.0 <= each <= 0.03 + 1e-9 for each in late)
    assert len({round(each, 6) for each in late}) > 20
    bench.clear('jitter')
    assert_normal(bench, client)


def test_coalesce_makes_one_piece_of_what_is_sent_in_a_time(bench):
    client = bench.client()
    bench.start('coalesce:seconds=0.017')
    messages = bench.stream(client, 8)
    assert [data for _, data in client.segments] == [
        b''.join(messages[:4]),
        b''.join(messages[4:]),
    ]
    assert client.times() == [17, 37]
    bench.clear('coalesce')
    assert_normal(bench, client)


def test_one_byte_per_segment(bench):
    client = bench.client()
    bench.start('one_byte:for=1')
    client.send(state(1), state(2))
    assert client.taken() == [bytes([byte]) for byte in state(1) + state(2)]
    bench.wait(1.0)
    assert_normal(bench, client)


def test_bit_errors_flip_as_many_bits_as_asked_for_in_their_share_of_the_messages(bench):
    client = bench.client()
    bench.start('bit_errors:rate=0.25,bits=3')
    messages = bench.stream(client, 1000)
    changed = [bits_changed(*pair) for pair in zip(messages, client.taken(), strict=True)]
    assert set(changed) == {0, 3}
    assert 200 < changed.count(3) < 300
    bench.clear('bit_errors')
    assert_normal(bench, client)


def test_bit_errors_reach_every_part_of_a_message(bench):
    client = bench.client()
    bench.start('bit_errors:rate=1,bits=1')
    hit = set()
    for number, message in enumerate(bench.stream(client, 3000)):
        flipped = client.segments[number][1]
        hit |= {index for index in range(60) if flipped[index] != message[index]}
    assert hit == set(range(60))


def test_wrong_length_strikes_one_message(bench):
    client = bench.client()
    bench.start('wrong_length:skip=2')
    messages = bench.stream(client, 4)
    taken = client.taken()
    assert taken[2] == struct.pack('<i', 60) + messages[2][4:]
    assert [taken[0], taken[1], taken[3]] == [messages[0], messages[1], messages[3]]
    assert_normal(bench, client)


@pytest.mark.parametrize('dialect_order', ByteOrder)
@pytest.mark.parametrize('value', [-1, 0, 11, 70_000, 2**31 - 1])
def test_wrong_length_of_any_value_is_refused_by_a_framer(bench, value, dialect_order):
    client = bench.client()
    bench.start(f'wrong_length:value={value}')
    message = state(1, BIG_ENDIAN) if dialect_order is ByteOrder.BIG else state(1)
    client.send(message)
    (data,) = client.taken()
    assert data == struct.pack(dialect_order.value + 'i', value) + message[4:]
    framer = Framer(dialect_order)
    framer.receive_data(data)
    with pytest.raises(FrameError, match='length'):
        framer.next_frame()


def test_lost_reply_strikes_replies_only_and_as_many_as_asked_for(bench):
    client = bench.client('motion')
    bench.start('lost_reply:count=2,skip=1')
    client.send(*(answer(0), state(0), answer(1), state(1), answer(2), answer(3)))
    assert client.taken() == [answer(0), state(0), state(1), answer(3)]
    assert client.wire.receive(ask(1)) == ask(1)
    assert_normal(bench, client)


def test_lost_reply_in_the_other_byte_order(bench):
    client = bench.client('motion')
    bench.start('lost_reply')
    client.send(state(0, BIG_ENDIAN), answer(0, BIG_ENDIAN), answer(1, BIG_ENDIAN))
    assert client.taken() == [state(0, BIG_ENDIAN), answer(1, BIG_ENDIAN)]


def test_late_reply_comes_late_once_and_nothing_overtakes_it(bench):
    client = bench.client('motion')
    bench.start('late_reply:seconds=0.5')
    client.send(state(0), answer(0), answer(1))
    assert client.taken() == [state(0)]
    assert bench.faults.active() == []
    bench.wait(0.4)
    client.send(answer(2))
    assert client.taken() == []
    bench.wait(0.1)
    assert client.taken() == [answer(0), answer(1), answer(2)]
    assert_normal(bench, client)


def test_late_reply_cleared_is_sent_at_once(bench):
    client = bench.client('motion')
    bench.start('late_reply:seconds=5,count=0')
    client.send(answer(0), state(1))
    bench.clear()
    assert client.taken() == [answer(0), state(1)]
    assert_normal(bench, client)


def test_wrong_byte_order_is_what_a_controller_of_the_other_order_sends(bench):
    client = bench.client()
    bench.start('wrong_byte_order')
    client.send(state(7), answer(8), state(9, BIG_ENDIAN), b'12345')
    expected = [state(7, BIG_ENDIAN), answer(8, BIG_ENDIAN), state(9), b'43215']
    assert client.taken() == expected
    framer = Framer(ByteOrder.LITTLE)
    framer.receive_data(expected[0])
    with pytest.raises(FrameError, match='byte order'):
        framer.next_frame()
    bench.clear('wrong_byte_order')
    assert_normal(bench, client)


def test_reboot_and_the_controllers_own_faults_leave_wires_alone(bench):
    client = bench.client()
    for name in set(FAULTS) - set(LINK_FAULTS):
        bench.start(name)
    bench.wait(10.0)
    bench.clear()
    assert_normal(bench, client)


@pytest.mark.parametrize('name', LINK_FAULTS)
def test_a_port_that_is_not_meant_is_not_disturbed(bench, name):
    untouched = bench.client('io')
    bench.start(f'{name}:port=state')
    sent = [answer(number) for number in range(20)]
    untouched.send(*sent)
    assert untouched.taken() == sent
    assert untouched.wire.receive(ask(1)) == ask(1)
    assert untouched.hung_up == 0


@pytest.mark.parametrize('name', LINK_FAULTS)
def test_what_a_client_sends_is_never_changed(bench, name):
    """No fault can make a motion: a session receives what was sent, or nothing."""
    client = bench.client('motion')
    bench.start(f'{name}:port=motion')
    for number in range(20):
        client.send(answer(number))
        assert client.wire.receive(ask(number)) in (ask(number), b'')
        bench.wait(0.01)


@pytest.mark.parametrize('name', LINK_FAULTS)
def test_cleared_faults_leave_nothing_behind(bench, name):
    client = bench.client('motion')
    bench.start(f'{name}:port=motion')
    bench.wait(0.5)
    client.send(state(1), answer(2), state(3))
    bench.clear()
    again = bench.client('motion') if client.hung_up else client
    assert_normal(bench, again)
    bench.wait(100.0)
    assert again.taken() == []
    assert bench.clock.next_due is None


@pytest.mark.parametrize('name', [name for name in LINK_FAULTS if name != 'cut'])
def test_a_fault_begins_after_its_time_and_ends_after_it_has_lasted(bench, name):
    client = bench.client('motion')
    counts = any(parameter.name == 'count' for parameter in FAULTS[name].parameters)
    unlimited = ',count=0' if counts else ''
    bench.start(f'{name}:port=motion,after=2,for=1{unlimited}')
    for when, disturbed in ((0.0, False), (1.9, False), (2.1, True), (2.9, True), (3.1, False)):
        bench.wait(when - bench.clock.now)
        client.taken()
        sent = [answer(number) for number in range(30)]
        client.send(*sent)
        assert (client.taken() != sent) is disturbed, when
        if disturbed:
            bench.wait(0.06)
        if name == 'late_reply':
            client.wire._release(1e9)  # the rest of the test is about what comes next
    assert bench.faults.active() == []


def test_faults_add_up_in_the_order_they_were_started(bench):
    client = bench.client()
    for text in ('delay:seconds=0.1', 'delay:seconds=0.2', 'one_byte', 'wrong_length:add=1'):
        bench.start(text)
    client.send(state(1))
    bench.wait(0.299)
    assert client.taken() == []
    bench.wait(0.002)
    assert client.taken() == [bytes([byte]) for byte in struct.pack('<i', 57) + state(1)[4:]]
    bench.start('coalesce:seconds=0.1')
    client.send(state(1), state(2))
    bench.wait(0.301)
    assert client.taken() == []
    bench.wait(0.1)
    assert b''.join(client.taken()) == state(1) + state(2)


@pytest.mark.parametrize(
    'text', ['jitter:seconds=0.2', 'jitter coalesce', 'coalesce late_reply', 'jitter late_reply']
)
def test_the_order_is_kept_and_nothing_is_sent_twice(bench, text):
    client = bench.client('motion')
    for fault in text.split():
        bench.start(fault)
    sent = []
    for number in range(400):
        message = answer(number) if number % 7 == 0 else state(number)
        sent.append(message)
        client.send(message)
        bench.wait(0.004)
        if number == 200:
            bench.clear()
            assert client.wire.held == 0
            bench.start(text.split()[0])
    bench.wait(5.0)
    times = [time for time, _ in client.segments]
    assert all(before <= after for before, after in pairwise(times))
    assert b''.join(client.taken()) == b''.join(sent)


@pytest.mark.parametrize('text', ['delay:seconds=60', 'coalesce:seconds=10', 'late_reply 60'])
def test_what_is_held_is_bounded(bench, text):
    client = bench.client('motion')
    bench.start(text)
    most = 0
    for number in range(10_000):
        client.send(answer(number))
        most = max(most, client.wire.held)
    assert MAX_HELD - 100 < most <= MAX_HELD
    assert client.hung_up == 1
    assert client.wire.held == 0
    bench.wait(100.0)
    assert client.taken() == []


def outcome(seed, *texts, before=()):
    """Return what two state clients get through these faults."""
    bench = FaultBench(seed)
    for port in before:
        bench.client(port)
    clients = [bench.client('state'), bench.client('state')]
    for text in texts:
        bench.start(text)
    for number in range(300):
        for client in clients:
            client.send(state(number))
        bench.wait(0.005)
    bench.wait(5.0)
    return [client.segments for client in clients]


RANDOM = ('jitter:port=state', 'bit_errors:rate=0.5,bits=4')


def test_the_same_seed_gives_the_same_bytes_at_the_same_times():
    assert outcome(5, *RANDOM) == outcome(5, *RANDOM)


def test_other_seeds_other_connections_and_other_faults_give_other_bytes():
    first, second = outcome(5, *RANDOM)
    assert first != second
    assert first not in outcome(6, *RANDOM)
    assert first not in outcome(5, *reversed(RANDOM))


def test_connections_of_other_ports_do_not_change_what_is_random():
    assert outcome(5, *RANDOM, before=('remote', 'motion', 'remote')) == outcome(5, *RANDOM)


def test_a_fault_that_comes_or_goes_does_not_begin_the_others_anew():
    def flipped(*texts):
        bench = FaultBench()
        client = bench.client()
        bench.start('bit_errors:rate=1,bits=8')
        for text in texts:
            client.send(state(1))
            if text:
                bench.start(text)
                bench.clear(text)
        client.send(state(1))
        return client.taken()

    assert flipped('frozen_encoder', 'one_byte', 'delay') == flipped('', '', '')
    assert len(set(flipped('delay', 'delay'))) == 3


def test_a_fault_with_a_seed_of_its_own_does_not_depend_on_the_others():
    alone = outcome(5, 'jitter:seed=3')
    assert outcome(6, 'jitter:seed=3') == alone
    assert outcome(6, 'bit_errors:rate=0', 'jitter:seed=3') == alone
    assert outcome(5, 'jitter:seed=4') != alone


def test_what_is_random_is_the_same_on_every_machine():
    bench = FaultBench(1)
    client = bench.client()
    bench.start('bit_errors:rate=1,bits=2')
    client.send(bytes(16))
    assert client.taken() == [bytes.fromhex('00000000000100000000000040000000')]


def test_a_closed_wire_sends_nothing_and_is_closed_only_once(bench):
    client = bench.client()
    bench.start('delay:seconds=1')
    client.send(state(1))
    client.wire.close()
    client.wire.close()
    assert bench.clock.next_due is None
    client.send(state(2))
    bench.start('cut')
    bench.wait(5.0)
    assert client.taken() == []
    assert client.hung_up == 0
    assert client.wire.receive(b'x') == b''
    assert client.wire.held == 0


def test_a_wire_opened_while_a_fault_is_active_is_disturbed(bench):
    bench.start('half_open')
    client = bench.client()
    client.send(state(1))
    assert client.taken() == []


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
def test_messages_are_told_apart(message, order, reply):
    assert byte_order(message) is order
    assert is_reply(message) is reply


def test_every_disturbance_is_a_fault_with_a_port():
    assert set(DISTURBANCES) | {'cut'} == set(LINK_FAULTS)
