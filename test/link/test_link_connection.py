# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The link with real sockets: connection, reconnection, and robustness against any peer."""

import asyncio
import errno
import gc
import os
import socket

import pytest
from support.event_loop import until
from support.link_harness import Harness, Peer, frame, joints
from support.sim_process import vacant_port

from epson_driver.link import LinkState, WireEvent
from epson_driver.simple_message import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    ByteOrder,
    Dialect,
    JointFeedback,
    JointPosition,
    JointTrajPt,
    Real,
    ReplyCode,
    encode,
    reply,
    request,
    topic,
)


async def silent(connection):
    await connection.stay()


async def greet(connection):
    """Send the connection's number as a joint position, and stay."""
    await connection.send(joints(float(connection.number)))
    await connection.stay()


def greetings(harness):
    return [message.joints[0] for message in harness.messages]


async def test_link_connects_when_the_controller_starts_later():
    port = vacant_port()
    async with Harness(port) as harness:
        await until(lambda: harness.states.count('backing_off') >= 2)
        assert not harness.link.connected
        async with Peer(greet, port):
            await until(lambda: harness.packets)
            assert greetings(harness) == [1.0]
        assert harness.link.statistics.connections == 1
        assert all(f'127.0.0.1:{port}' in why for why in harness.reasons('backing_off'))
        assert 'connect' in harness.reasons('backing_off')[0].lower()


async def test_proven_link_reconnects_without_a_delay(monkeypatch):
    monkeypatch.setattr('epson_driver.link.link.MIN_PROVEN_UPTIME_S', 0.1)
    monkeypatch.setattr('epson_driver.link.link.back_off', lambda n: 0.0 if n < 3 else 5.0)

    ended = []

    async def talk(connection):
        if connection.number == 4:
            await connection.send(joints(1.0))
            await asyncio.sleep(0.2)  # the link counts as proven
            ended.append(asyncio.get_running_loop().time())
        elif connection.number > 4:
            await greet(connection)

    async with Peer(talk) as peer, Harness(peer.port) as harness:
        await until(lambda: len(harness.packets) == 2)
        assert peer.times[4] - ended[0] < 1.0


async def close_immediately(connection):
    connection.close()


async def crash(connection):
    connection.reset()


async def send_garbage(connection):
    await connection.send(b'\xff' * 64)
    await connection.stay()


async def announce_too_much(connection):
    await connection.send(b'\x38\x00\x00\x00' + b'\x00' * 56, b'\x00\x00\x01\x00')
    await connection.stay()


async def stop_in_a_frame(connection):
    await connection.send(joints(9.0)[:30])


@pytest.mark.parametrize(
    ('talk', 'reason'),
    [
        (close_immediately, 'closed by the controller'),
        (crash, 'reset'),
        (send_garbage, 'length = -1: must be 12'),
        (announce_too_much, 'length = 65536: must be 12'),
        (stop_in_a_frame, 'closed by the controller'),
        (silent, 'silent for 0.2 s'),
    ],
    ids=lambda value: getattr(value, '__name__', None),
)
async def test_link_reconnects_after_any_end_of_a_connection(talk, reason):
    async def first_fails(connection):
        await (talk if connection.number == 1 else greet)(connection)

    async with (
        Peer(first_fails) as peer,
        Harness(peer.port, receive_timeout=0.2) as harness,
    ):
        await until(lambda: peer.connections >= 2 and harness.packets)
        assert greetings(harness)[0] == 2.0
        assert reason in harness.reasons('backing_off')[0].lower()
        assert harness.states[:5] == [
            'connecting',
            'connected',
            'backing_off',
            'connecting',
            'connected',
        ]


@pytest.mark.parametrize(('between', 'lost'), [(0.002, False), (0.01, True)])
async def test_complete_messages_reset_the_timeout_and_single_bytes_do_not(between, lost):
    """The bytes of a message take 0.13 s or 0.64 s, and the timeout is 0.2 s."""

    async def dribble(connection):
        while True:
            for byte in joints(1.0):
                await connection.send(bytes([byte]))
                await asyncio.sleep(between)

    async with Peer(dribble) as peer, Harness(peer.port, receive_timeout=0.2) as harness:
        await until(lambda: len(harness.packets) > 20 or peer.connections > 1)
        assert (peer.connections > 1) == lost
        if lost:
            assert 'silent for 0.2 s' in harness.reasons('backing_off')[0]


async def test_link_reconnects_after_a_keepalive_timeout(monkeypatch):
    """A pulled cable ends as ETIMEDOUT, which Python raises as TimeoutError."""
    timed_out = TimeoutError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))
    read = socket.socket.recv_into
    calls = []

    def fail_once(sock, *args):
        calls.append(sock)
        if len(calls) == 1:
            raise timed_out
        return read(sock, *args)

    async def talk(connection):
        await connection.send(joints(1.0))
        await asyncio.Event().wait()  # without reading

    async with Peer(talk) as peer:
        monkeypatch.setattr(socket.socket, 'recv_into', fail_once)
        async with Harness(peer.port) as harness:  # the motion link has no receive timeout
            await until(lambda: harness.packets or not harness.running)
            assert harness.running
            assert os.strerror(errno.ETIMEDOUT) in harness.reasons('backing_off')[0]
            await until(lambda: harness.packets)
        monkeypatch.undo()


async def test_attempts_slow_down_if_the_server_closes_connections():
    async with Peer(close_immediately) as peer, Harness(peer.port):
        await asyncio.sleep(1.2)
        assert 3 <= peer.connections <= 7
        assert peer.times[-1] - peer.times[-2] > peer.times[2] - peer.times[1] > 0.05


DIALECTS = [Dialect(order, real) for order in ByteOrder for real in Real]


@pytest.mark.parametrize('dialect', DIALECTS, ids=lambda d: f'{d.byte_order.name} {d.real.name}')
async def test_requests_use_the_detected_dialect(dialect):
    state = encode(topic(JointPosition(0, (0.25,) * 10)), dialect)
    feedback = encode(topic(JointFeedback(0, 2, 0.0, (0.25,) * 10)), dialect)
    point = encode(request(JointTrajPt(1, (0.5,) * 10, 0.1, 2.0)), dialect)

    async def talk(connection):
        await connection.send(state if connection.number == 1 else feedback)
        await connection.receive(len(point))
        await connection.send(encode(reply(JointPosition(1), ReplyCode.SUCCESS), dialect))
        await connection.stay()

    async with Peer(talk) as peer, Harness(peer.port) as harness:
        await until(lambda: harness.packets)
        assert harness.messages[0].joints == (0.25,) * 10
        assert harness.link.dialect == dialect
        answers = []
        harness.link.post(JointTrajPt(1, (0.5,) * 10, 0.1, 2.0), lambda *a: answers.append(a))
        await until(lambda: answers)
        assert bytes(peer.received) == point


async def test_byte_order_is_detected_again_after_a_reconnect():
    async def talk(connection):
        order = '<' if connection.number == 1 else '>'
        await connection.send(joints(0.5, order=order))
        if connection.number > 1:
            await connection.stay()

    async with Peer(talk) as peer, Harness(peer.port) as harness:
        await until(lambda: len(harness.packets) == 2)
        assert greetings(harness) == [0.5, 0.5]
        assert harness.link.dialect == BIG_ENDIAN


@pytest.mark.parametrize('sends', [True, False], ids=['sent', 'received'])
async def test_link_used_in_another_byte_order_than_the_state_reconnects(sends):
    """Otherwise the sent bytes are lost, and the next reply ends the connection in a motion."""
    async with Peer(silent if sends else greet) as peer, Harness(peer.port) as harness:
        link = harness.link
        await until(lambda: link.connected)
        if sends:
            link.follow(LITTLE_ENDIAN)
            link.post(JointTrajPt(1), lambda *_: None)
            link.follow(LITTLE_ENDIAN)
        else:
            await until(lambda: harness.packets)
            link.follow(link.dialect)
        assert peer.connections == 1
        other = BIG_ENDIAN if link.dialect == LITTLE_ENDIAN else LITTLE_ENDIAN
        link.follow(other)
        await until(lambda: peer.connections == 2)
        await until(lambda: link.connected)
        assert ', but the state port uses' in harness.reasons('backing_off')[0]
        assert len(harness.reasons('backing_off')) == 1


async def test_configured_byte_order_is_not_detected():
    async with (
        Peer(greet) as peer,
        Harness(peer.port, byte_order=ByteOrder.BIG) as harness,
    ):
        assert harness.link.dialect == BIG_ENDIAN
        await until(lambda: harness.reasons('backing_off'))
        assert 'is the byte order right?' in harness.reasons('backing_off')[0]
        assert not harness.packets


BAD = [
    ('msg_type', frame(0, 1)),
    ('comm_type', frame(10, 0, 0, b'\x00' * 44)),
    ('comm_type', frame(10, 7, 0, b'\x00' * 44)),
    ('reply_code', frame(10, 1, 1, b'\x00' * 44)),
    ('reply_code', frame(10, 3, 0, b'\x00' * 44)),
    ('body', frame(10, 1, 0, b'\x00' * 43)),
    ('body', frame(13, 1, 0, b'')),
]


async def test_bad_frame_increments_its_field_without_a_reconnect():
    async def talk(connection):
        for _field, data in BAD:
            await connection.send(data)
        await greet(connection)

    async with Peer(talk) as peer, Harness(peer.port) as harness:
        await until(lambda: harness.packets)
        assert greetings(harness) == [1.0]
        assert harness.link.statistics.bad_frames == {
            'msg_type': 1,
            'comm_type': 2,
            'reply_code': 2,
            'body': 2,
        }
        assert peer.connections == 1
        assert harness.link.statistics.frames_received == len(BAD) + 1


@pytest.mark.parametrize('order', '<>')
@pytest.mark.parametrize(
    ('requested', 'answer'),
    [
        ((1, 2, 0, b''), (1, 3, 1, b'')),
        ((1, 2, 0, b'\x00' * 40), (1, 3, 1, b'\x00' * 40)),
        ((2, 2, 0, b''), (2, 3, 2, b'')),
        ((1503, 2, 0, b'\x01\x02\x03'), (1503, 3, 2, b'')),
        ((13, 2, 0, b'\x00' * 28), (13, 3, 2, b'')),
        ((10, 2, 0, b'\x00' * 44), (10, 3, 2, b'')),
    ],
    ids=['PING', 'PING of the REP', 'GET_VERSION', 'vendor type', 'STATUS', 'JOINT_POSITION'],
)
async def test_requests_to_the_client_are_answered(requested, answer, order):
    expected = frame(*answer, order=order)

    async def talk(connection):
        await connection.send(frame(*requested, order=order))
        await connection.receive(len(expected))
        await connection.send(joints(1.0, order=order))
        await connection.stay()

    async with Peer(talk) as peer, Harness(peer.port) as harness:
        await until(lambda: harness.packets)
        assert bytes(peer.received) == expected
        assert len(harness.packets) == 1  # requests are not passed to the owner


async def test_unsolicited_reply_is_passed_to_the_owner():
    async def talk(connection):
        await connection.send(joints(comm_type=3, reply_code=2, sequence=4))
        await connection.stay()

    async with Peer(talk) as peer, Harness(peer.port) as harness:
        await until(lambda: harness.packets)
        assert harness.packets[0].reply_code is ReplyCode.FAILURE
        assert harness.link.statistics.unsolicited_replies == 1


async def test_reply_is_delivered_once_with_its_time():
    async def talk(connection):
        for _ in range(3):
            await connection.read_frame()
            await connection.send(joints(comm_type=3, reply_code=1))
        await connection.stay()

    async with Peer(talk) as peer, Harness(peer.port) as harness:
        await harness.connected()
        now = asyncio.get_running_loop().time
        answers = []
        for sequence in range(3):
            sent = now()
            harness.link.post(JointTrajPt(sequence), lambda *a: answers.append(a))
            await until(lambda: len(answers) == sequence + 1)  # noqa: B023 - awaited here
            packet, received = answers[-1]
            assert packet.reply_code is ReplyCode.SUCCESS
            assert sent <= received <= now()
        assert not harness.packets
        latencies = harness.link.statistics.reply_latencies
        assert len(latencies) == 3
        assert all(0.0 <= latency < 1.0 for latency in latencies)


async def test_pending_request_is_dropped_with_the_connection():
    async def talk(connection):
        if connection.number == 1:
            await connection.read_frame()
            return  # without an answer
        await connection.send(joints(comm_type=3, reply_code=1))  # too late, on a new connection
        await connection.stay()

    async with Peer(talk) as peer, Harness(peer.port) as harness:
        await harness.connected()
        answers = []
        harness.link.post(JointTrajPt(0), lambda *a: answers.append(a))
        await until(lambda: harness.packets)
        assert peer.connections == 2
        assert not answers
        assert harness.link.statistics.unsolicited_replies == 1


async def test_reconnect_sends_posted_requests_first_and_drops_their_replies():
    async with Peer(silent) as peer, Harness(peer.port) as harness:
        await harness.connected()
        answers = []
        harness.link.post(JointTrajPt(0), lambda *a: answers.append(a))
        harness.link.reconnect('a reply is missing')
        with pytest.raises(ConnectionError):
            harness.link.post(JointTrajPt(1), lambda *a: answers.append(a))
        await until(lambda: peer.connections == 2 and harness.link.connected)
        assert harness.states[-3:] == ['backing_off', 'connecting', 'connected']
        assert harness.reasons('backing_off') == [f'127.0.0.1:{peer.port}: a reply is missing']
        assert len(peer.received) == 68  # one point
        assert not answers


async def test_messages_after_the_reason_to_reconnect_are_dropped():
    async def talk(connection):
        await connection.send(joints(1.0) + joints(2.0))
        await connection.stay()

    async with Peer(talk) as peer, Harness(peer.port) as harness:
        harness.on_packet = lambda _: harness.link.reconnect('enough')
        await until(lambda: peer.connections == 2)
        assert greetings(harness)[0] == 1.0
        assert 2.0 not in greetings(harness)
        assert harness.reasons('backing_off')[0].endswith('enough')


@pytest.mark.invariant(9)
@pytest.mark.parametrize('where', ['packet', 'trace', 'turn'])
async def test_inv9_error_of_the_owner_ends_the_link_and_is_raised(where):
    """asyncio only logs an exception of a protocol."""
    many = 60 if where == 'turn' else 1

    async def talk(connection):
        await connection.send(joints(1.0) * many)
        await connection.stay()

    async with Peer(talk) as peer:
        harness = Harness(peer.port)

        def fail(*_):
            if len(harness.packets) == many:
                raise LookupError('a mistake')

        if where == 'trace':
            harness.link.trace = lambda event, _: event is WireEvent.RECEIVED and 1 / 0
        else:
            harness.on_packet = fail
        with pytest.raises((LookupError, ZeroDivisionError)):
            await harness.link.run()
        await until(lambda: not peer.busy)
        assert not harness.link.connected


async def test_trace_and_statistics_have_the_bytes_of_both_directions():
    traced = {event: bytearray() for event in WireEvent}
    steps = []
    sent = bytearray()

    async def talk(connection):
        for data in (joints(1.0), frame(1, 2), frame(99, 7)):
            sent.extend(data)
            await connection.send(data)
        await connection.receive(16)
        await connection.read_frame()
        data = frame(11, 3, 1)
        sent.extend(data)
        await connection.send(data)
        await connection.stay()

    def trace(direction, data):
        assert isinstance(data, bytes)
        traced[direction] += data
        steps.append(direction)

    async with Peer(talk) as peer, Harness(peer.port, trace=trace) as harness:
        await until(lambda: harness.packets)
        answers = []
        harness.link.post(JointTrajPt(0), lambda *a: answers.append(a))
        await until(lambda: answers)
        assert traced['received'] == sent
        assert traced['sent'] == peer.received
        counted = harness.link.statistics
        assert counted.bytes_received == len(sent)
        assert counted.bytes_sent == len(peer.received)
        assert counted.frames_received == 4
        assert counted.frames_sent == 2
        assert counted.connections == 1
        assert counted.bad_frames.total() == 1
    assert steps[0] == 'opened'
    assert steps[-1] == 'closed'
    assert not {'opened', 'closed', 'ended', 'reset'}.intersection(steps[1:-1])


async def test_socket_has_no_delay_and_a_short_keepalive():
    async with Peer(silent) as peer, Harness(peer.port) as harness:
        await harness.connected()
        ours = harness.link.transport.get_extra_info('socket')
        assert ours.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        assert ours.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        if hasattr(socket, 'TCP_KEEPIDLE'):
            idle = ours.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE)
            interval = ours.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL)
            count = ours.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT)
            assert idle + interval * count <= 5


@pytest.mark.invariant(7)
async def test_inv7_peer_that_requests_and_never_reads_is_disconnected():
    sizes = []

    async def request_forever(connection):
        connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        pings = frame(1, 2, 0, b'\x00' * 40) * 200
        for _ in range(400):
            await connection.send(pings)

    async def talk(connection):
        if connection.number == 1:
            await request_forever(connection)
        else:
            await greet(connection)

    def trace(_direction, _data):
        sizes.append(harness.link.transport.get_write_buffer_size())

    async with Peer(talk) as peer, Harness(peer.port, trace=trace) as harness:
        await harness.connected()
        ours = harness.link.transport.get_extra_info('socket')
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        await until(lambda: harness.packets)
        assert max(sizes) <= 200_000
        assert 'does not read' in harness.reasons('backing_off')[0]


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    'data',
    [
        b'GET / HTTP/1.1\r\nHost: robot\r\n\r\n',
        bytes(4096),
        b'\xff\xff\xff\x7f' * 100,
        joints(1.0)[:-1] + joints(2.0),
        frame(10, 1, 0, b'\x7f' * 44) * 50,
        frame(13, 1, 0, b'\xff' * 28),
        frame(15, 1, 0, b'\xff' * 132),
        frame(12, 1, 0, b'\xff' * 528),
        frame(2**31 - 1, 2, 0, b'x' * 1000),
    ],
    ids=range(9),
)
async def test_inv7_next_connection_works_after_any_bytes(data):
    async def talk(connection):
        if connection.number == 1:
            await connection.send(data)
        else:
            await connection.send(joints(42.0))
            await connection.stay()

    async with Peer(talk) as peer, Harness(peer.port, receive_timeout=0.5) as harness:
        await until(lambda: JointPosition(0, (42.0,) + (0.0,) * 9) in harness.messages)
        assert harness.running


@pytest.mark.invariant(7)
async def test_inv7_closing_leaves_no_task_and_no_socket():
    vacant = vacant_port()
    before = open_sockets()
    async with Peer(silent) as peer:
        for _ in range(20):
            harness = Harness(peer.port)
            async with harness:
                await harness.connected()
            assert harness.link.state is LinkState.DISCONNECTED
            assert harness.changes[-1][1] == 'closed'
        await until(lambda: not peer.busy)  # every connection has ended
    refused = Harness(vacant)
    async with refused:
        await until(lambda: refused.reasons('backing_off'))
    assert refused.link.state is LinkState.DISCONNECTED
    await until(lambda: open_sockets() <= before)
    assert asyncio.all_tasks() == {asyncio.current_task()}
    gc.collect()  # an open transport would warn here, which is an error


def open_sockets():
    folder = '/proc/self/fd'
    if not os.path.isdir(folder):  # noqa: PTH112 - os.readlink follows
        return 0
    links = []
    for name in os.listdir(folder):  # noqa: PTH208
        try:
            links.append(os.readlink(f'{folder}/{name}'))  # noqa: PTH115
        except OSError:
            continue
    return sum(link.startswith('socket:') for link in links)
