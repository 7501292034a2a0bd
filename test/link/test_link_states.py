# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The link's state table, and the receive timeout that ends a connection."""

import asyncio
import logging
import socket

import pytest
from support.event_loop import now, run, stand_still, until
from support.link_harness import Harness, Peer, frame, joints

from epson_driver.link import Link, link_reports
from epson_driver.link.connection import (
    MAX_FRAMES_PER_TURN,
    SLICES,
    ReceiveTimeout,
    wait_for_silence,
)
from epson_driver.link.link_reports import MAX_SHORT, LinkReports
from epson_driver.link.states import TRANSITIONS, LinkEvent, LinkState, back_off


def test_open_link_is_disconnected_only_by_close():
    for state in set(LinkState) - {LinkState.DISCONNECTED}:
        assert TRANSITIONS[state, LinkEvent.CLOSE] is LinkState.DISCONNECTED
    for (_, event), following in TRANSITIONS.items():
        assert (following is LinkState.DISCONNECTED) == (event is LinkEvent.CLOSE)


def test_back_off_grows_from_zero_to_one_second():
    waits = [back_off(attempt) for attempt in range(1000)]
    assert waits[0] == 0.0
    assert waits == sorted(waits)
    assert waits[1] > 0.0
    assert waits[-1] == max(waits) == 1.0


async def test_refusal_of_a_second_client_is_logged_once(caplog, monkeypatch):
    """A port that serves one client closes every other connection immediately."""
    caplog.set_level(logging.INFO)
    monkeypatch.setattr(link_reports, 'SHORT_S', 2.0)  # independent of the machine's speed

    accepted = 0
    served = False
    end = asyncio.Event()

    async def serve(_reader, writer):
        nonlocal accepted
        accepted += 1
        if served:
            await end.wait()
        writer.close()

    server = await asyncio.start_server(serve, '127.0.0.1', 0)
    port = server.sockets[0].getsockname()[1]
    link = Link(
        'motion',
        '127.0.0.1',
        port,
        on_packet=lambda _: None,
        on_state=lambda _, why: reports.log_state(why),
    )
    reports = LinkReports(link, 'simulated, c3_a601s')
    task = asyncio.create_task(link.run())
    await until(lambda: accepted >= MAX_SHORT + 2)
    assert len([line for line in caplog.messages if 'another client is connected' in line]) == 1
    count = len(caplog.messages)
    await until(lambda: accepted >= MAX_SHORT + 3)
    assert len(caplog.messages) == count
    served = True
    await until(lambda: len(caplog.messages) > count)
    assert caplog.messages[-1] == (
        f'motion link connected: 127.0.0.1:{port}, configured as simulated, c3_a601s'
    )
    end.set()
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    server.close()


MANY = 1000


def sends(data):
    async def talk(connection):
        await connection.send(data)
        await connection.stay()

    return talk


async def test_other_callbacks_run_between_frames():
    async with Peer(sends(joints(1.0) * MANY)) as peer, Harness(peer.port) as harness:
        burst, seen = 0, 0
        while seen < MANY:
            await asyncio.sleep(0)
            burst, seen = max(burst, len(harness.packets) - seen), len(harness.packets)
        assert 0 < burst <= MAX_FRAMES_PER_TURN


async def test_time_for_handling_messages_is_not_silence():
    """Handling received messages may take longer than the receive timeout."""
    async with (
        Peer(sends(joints(1.0) * MANY)) as peer,
        Harness(peer.port, receive_timeout=0.5) as harness,
    ):
        while len(harness.packets) < MANY:
            if harness.packets:
                stand_still(0.04)  # other work, longer than the timeout in total
            await asyncio.sleep(0)
        assert 'backing_off' not in harness.states


def test_many_bad_frames_are_counted_and_logged_rarely(caplog):
    async def scenario():
        bad = frame(10, 1, body=b'short')
        async with Peer(sends(bad * MANY)) as peer, Harness(peer.port) as harness:
            await until(lambda: harness.link.statistics.bad_frames['body'] == MANY)

    with caplog.at_level(logging.WARNING):
        run(scenario())
    assert 1 <= len([text for text in caplog.messages if 'bad frame' in text]) < MANY / 10


TIMEOUT = 0.4


def test_receive_timeout_expires_after_its_slices():
    silence = ReceiveTimeout(2.0)
    assert silence.slice * SLICES == silence.timeout == 2.0
    silence.restart(10.0)
    assert silence.time_left(10.1) == pytest.approx(silence.slice - 0.1)
    assert [silence.end_slice(11.0) for _ in range(SLICES)] == [False] * (SLICES - 1) + [True]
    assert silence.time_left(11.0) == silence.slice


def test_received_message_restarts_the_timeout():
    silence = ReceiveTimeout(2.0)
    for _ in range(5):
        for _ in range(SLICES - 1):
            assert not silence.end_slice(10.0)
        silence.restart(11.0)
        assert silence.time_left(11.0) == silence.slice
    assert [silence.end_slice(12.0) for _ in range(SLICES)] == [False] * (SLICES - 1) + [True]


@pytest.mark.parametrize('phase', [0.0, 0.3, 0.9])
async def test_timeout_starts_at_the_last_message(phase):
    """`phase` is the position of the message within a slice."""
    silence = ReceiveTimeout(2.0)
    start = now()
    last = start + (10.0 + phase) * silence.slice
    loop = asyncio.get_running_loop()
    loop.call_at(start + 1.0, lambda: silence.restart(now()))
    loop.call_at(last, lambda: silence.restart(now()))
    await wait_for_silence(silence)
    assert now() - last == pytest.approx(2.0, abs=1e-3)


async def test_message_in_the_socket_is_read_before_the_timeout_expires():
    """If a timer is overdue and a socket readable, the reader runs first."""
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    silence = ReceiveTimeout(0.01 * SLICES)
    received = []

    def read():
        received.append(ours.recv(10))
        silence.restart(now())

    loop = asyncio.get_running_loop()
    loop.add_reader(ours, read)
    last_slice = now() + 0.01 * (SLICES - 1)
    waiting = asyncio.create_task(wait_for_silence(silence))
    # the stall may be scheduled just before the timer
    loop.call_at(last_slice + 0.009, lambda: (stand_still(0.1), theirs.send(b'state')))
    await until(lambda: received)
    arrival = now()
    await waiting
    assert now() - arrival == pytest.approx(silence.timeout, abs=1e-3)
    loop.remove_reader(ours)
    theirs.close()
    ours.close()


async def test_stall_of_the_event_loop_is_not_a_silence_of_the_peer():
    """Each stall is longer than the timeout, and the peer sends continuously."""

    async def talk(connection):
        while True:
            await connection.send(joints(1.0))
            await asyncio.sleep(TIMEOUT / 20)

    async with Peer(talk) as peer, Harness(peer.port, receive_timeout=TIMEOUT) as harness:
        await harness.connected()
        for _ in range(4):
            stand_still(2 * TIMEOUT)  # the peer stalls too, because it is in this loop
            seen = len(harness.packets)
            await until(lambda seen=seen: len(harness.packets) > seen + 2)
        assert harness.states == ['connecting', 'connected']


async def test_stalls_of_the_event_loop_do_not_count_as_silence():
    """The connection lasts through three timeouts, in which the loop rarely runs."""
    async with (
        Peer(sends(joints(1.0))) as peer,
        Harness(peer.port, receive_timeout=TIMEOUT) as harness,
    ):
        await until(lambda: harness.packets)
        for _ in range(3):  # fewer than SLICES
            stand_still(TIMEOUT)
            await asyncio.sleep(0)
        assert harness.link.connected
        await until(lambda: 'backing_off' in harness.states)  # a silent peer is lost
        assert f'silent for {TIMEOUT} s' in harness.reasons('backing_off')[0]


async def test_silent_peer_is_lost_exactly_after_the_timeout():
    async with (
        Peer(sends(joints(1.0))) as peer,
        Harness(peer.port, receive_timeout=TIMEOUT) as harness,
    ):
        await until(lambda: harness.packets)
        last = now()
        await until(lambda: 'backing_off' in harness.states)
        assert now() - last == pytest.approx(TIMEOUT, abs=1e-3)
