# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The link's table of states, and the receive timeout that ends a connection."""

import asyncio
import logging
import socket

import pytest
from support.event_loop import now, run, stand_still, until
from support.link_harness import Harness, Peer, frame, joints

from epson_driver.link import Link, link_reports
from epson_driver.link.connection import MAX_FRAMES_PER_TURN, SLICES, ReceiveTimeout, silent
from epson_driver.link.link_reports import MAX_SHORT, LinkReports
from epson_driver.link.states import TRANSITIONS, LinkEvent, LinkState, back_off


def test_an_open_link_can_always_be_closed_and_never_ends_by_itself():
    for state in set(LinkState) - {LinkState.DISCONNECTED}:
        assert TRANSITIONS[state, LinkEvent.CLOSE] is LinkState.DISCONNECTED
    for (_, event), following in TRANSITIONS.items():
        assert (following is LinkState.DISCONNECTED) == (event is LinkEvent.CLOSE)


def test_the_published_names():
    assert {state.value for state in LinkState} == {
        'disconnected',
        'connecting',
        'connected',
        'backing_off',
    }


def test_back_off_begins_at_once_never_shrinks_and_is_at_most_a_second():
    waits = [back_off(attempt) for attempt in range(1000)]
    assert waits[0] == 0.0
    assert waits == sorted(waits)
    assert waits[1] > 0.0
    assert waits[-1] == max(waits) == 1.0


async def test_a_second_client_is_told_once_and_then_of_the_change(caplog, monkeypatch):
    """Of a port that serves one client, every other connection is closed at once."""
    caplog.set_level(logging.INFO)
    monkeypatch.setattr(link_reports, 'SHORT_S', 2.0)  # however slow this machine is

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
        on_state=lambda _, why: reports.tell(why),
    )
    reports = LinkReports(link, 'simulated, c3_a601s')
    task = asyncio.create_task(link.run())
    await until(lambda: accepted >= MAX_SHORT + 2)
    told = [line for line in caplog.messages if 'serves one client' in line]
    assert len(told) == 1
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


async def test_others_have_their_turn_between_frames():
    async with Peer(sends(joints(1.0) * MANY)) as peer, Harness(peer.port) as harness:
        most, seen = 0, 0
        while seen < MANY:
            await asyncio.sleep(0)
            most, seen = max(most, len(harness.packets) - seen), len(harness.packets)
        assert 0 < most <= MAX_FRAMES_PER_TURN


async def test_a_turn_of_others_is_no_silence():
    """What was received may take longer to handle than the link waits for more."""
    async with (
        Peer(sends(joints(1.0) * MANY)) as peer,
        Harness(peer.port, receive_timeout=0.5) as harness,
    ):
        while len(harness.packets) < MANY:
            if harness.packets:
                _be_busy()
            await asyncio.sleep(0)
        assert 'backing_off' not in harness.states


def _be_busy():
    """Hold the loop, as other robots' work may: in all turns together longer than the timeout."""
    stand_still(0.04)


def test_many_bad_frames_are_counted_and_the_log_has_a_line(caplog):
    async def scenario():
        bad = frame(10, 1, body=b'short')
        async with Peer(sends(bad * MANY)) as peer, Harness(peer.port) as harness:
            await until(lambda: harness.link.statistics.bad_frames['body'] == MANY)

    with caplog.at_level(logging.WARNING):
        run(scenario())
    assert 1 <= len([text for text in caplog.messages if 'bad frame' in text]) < MANY / 10


TIMEOUT = 0.4


def test_the_patience_is_over_after_its_slices():
    silence = ReceiveTimeout(2.0)
    assert silence.slice * SLICES == silence.patience == 2.0
    silence.heard(10.0)
    assert silence.left(10.1) == pytest.approx(silence.slice - 0.1)
    assert [silence.passed(11.0) for _ in range(SLICES)] == [False] * (SLICES - 1) + [True]
    assert silence.left(11.0) == silence.slice


def test_what_is_heard_begins_it_anew():
    silence = ReceiveTimeout(2.0)
    for _ in range(5):
        for _ in range(SLICES - 1):
            assert not silence.passed(10.0)
        silence.heard(11.0)
        assert silence.left(11.0) == silence.slice
    assert [silence.passed(12.0) for _ in range(SLICES)] == [False] * (SLICES - 1) + [True]


@pytest.mark.parametrize('phase', [0.0, 0.3, 0.9])
async def test_the_patience_counts_from_what_was_heard_last(phase):
    """Wherever in a slice that was."""
    silence = ReceiveTimeout(2.0)
    began = now()
    heard = began + (10.0 + phase) * silence.slice
    loop = asyncio.get_running_loop()
    loop.call_at(began + 1.0, lambda: silence.heard(now()))
    loop.call_at(heard, lambda: silence.heard(now()))
    await silent(silence)
    assert now() - heard == pytest.approx(2.0, abs=1e-3)


async def test_what_came_while_the_loop_stood_still_is_read_first():
    """A timer that is overdue and a socket that is readable: the reader has had its turn."""
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    silence = ReceiveTimeout(0.01 * SLICES)
    heard = []

    def read():
        heard.append(ours.recv(10))
        silence.heard(now())

    loop = asyncio.get_running_loop()
    loop.add_reader(ours, read)
    last_slice = now() + 0.01 * (SLICES - 1)
    waiting = asyncio.create_task(silent(silence))
    # what holds the loop up may stand in line right before the timer
    loop.call_at(last_slice + 0.009, lambda: (stand_still(0.1), theirs.send(b'state')))
    await until(lambda: heard)
    came = now()
    await waiting
    assert now() - came == pytest.approx(silence.patience, abs=1e-3)
    loop.remove_reader(ours)
    theirs.close()
    ours.close()


def silent_after(data):
    async def talk(connection):
        await connection.send(data)
        await connection.stay()

    return talk


async def test_a_loop_that_stood_still_is_not_the_peers_silence():
    """Each time longer than the link waits; the peer sent all the while."""

    async def talk(connection):
        while True:
            await connection.send(joints(1.0))
            await asyncio.sleep(TIMEOUT / 20)

    async with Peer(talk) as peer, Harness(peer.port, receive_timeout=TIMEOUT) as harness:
        await harness.connected()
        for _ in range(4):
            stand_still(2 * TIMEOUT)  # the peer is in this loop: it cannot send either
            seen = len(harness.packets)
            await until(lambda seen=seen: len(harness.packets) > seen + 2)
        assert harness.states == ['connecting', 'connected']


async def test_time_in_which_the_loop_stood_still_is_no_silence():
    """Nothing comes, and the loop is hardly there: after three patiences it still waits."""
    async with (
        Peer(silent_after(joints(1.0))) as peer,
        Harness(peer.port, receive_timeout=TIMEOUT) as harness,
    ):
        await until(lambda: harness.packets)
        stood = 0.0
        while stood < 3 * TIMEOUT:  # less than SLICES times
            stand_still(TIMEOUT)
            stood += TIMEOUT
            await asyncio.sleep(0)
        assert harness.link.connected
        await until(lambda: 'backing_off' in harness.states)  # and a silent peer is lost
        assert f'silent for {TIMEOUT} s' in harness.reasons('backing_off')[0]


async def test_a_silent_peer_is_lost_after_its_patience_and_neither_sooner_nor_later():
    async with (
        Peer(silent_after(joints(1.0))) as peer,
        Harness(peer.port, receive_timeout=TIMEOUT) as harness,
    ):
        await until(lambda: harness.packets)
        heard = now()
        await until(lambda: 'backing_off' in harness.states)
        assert now() - heard == pytest.approx(TIMEOUT, abs=1e-3)
