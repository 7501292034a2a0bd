# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Silence is what could have been heard and was not: a process that stood still heard nothing."""

import asyncio
import socket

from support.event_loop import now, run, stand_still, until
from support.link_harness import Harness, Peer, joints

from epson_driver.link.silence import SLICES, Silence, passed

TIMEOUT = 0.4


def test_the_patience_is_over_after_its_slices():
    silence = Silence(2.0)
    assert silence.slice * SLICES == silence.patience == 2.0
    assert [silence.passed() for _ in range(SLICES)] == [False] * (SLICES - 1) + [True]


def test_what_is_heard_begins_it_anew():
    silence = Silence(2.0)
    for _ in range(5):
        for _ in range(SLICES - 1):
            assert not silence.passed()
        silence.heard()
    # the slice in which it was heard does not count: it may have been at its end
    assert [silence.passed() for _ in range(SLICES + 1)] == [False] * SLICES + [True]
    silence.restart()
    assert [silence.passed() for _ in range(SLICES)] == [False] * (SLICES - 1) + [True]


def test_what_came_while_the_loop_stood_still_is_read_first():
    """A timer that is overdue and a socket that is readable: the reader has had its turn."""

    async def scenario():
        ours, theirs = socket.socketpair()
        ours.setblocking(False)
        silence = Silence(0.01 * SLICES)
        heard = []

        def read():
            heard.append(ours.recv(10))
            silence.heard()

        loop = asyncio.get_running_loop()
        loop.add_reader(ours, read)
        for _ in range(SLICES - 1):
            assert not silence.passed()
        waiting = asyncio.create_task(passed(silence))
        await asyncio.sleep(0)
        # what holds the loop up may stand in line right before the timer
        loop.call_at(loop.time() + 0.009, lambda: (stand_still(0.1), theirs.send(b'state')))
        assert not await waiting
        assert heard == [b'state']
        loop.remove_reader(ours)
        theirs.close()
        ours.close()

    run(scenario())


def silent_after(data):
    async def talk(connection):
        await connection.send(data)
        await connection.stay()

    return talk


def test_a_loop_that_stood_still_is_not_the_peers_silence():
    """Each time longer than the link waits; the peer sent all the while."""

    async def scenario():
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

    run(scenario())


def test_time_in_which_the_loop_stood_still_is_no_silence():
    """Nothing comes, and the loop is hardly there: after three patiences it still waits."""

    async def scenario():
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

    run(scenario())


def test_a_silent_peer_is_lost_after_its_patience_and_not_before():
    async def scenario():
        async with (
            Peer(silent_after(joints(1.0))) as peer,
            Harness(peer.port, receive_timeout=TIMEOUT) as harness,
        ):
            await until(lambda: harness.packets)
            heard = now()
            await until(lambda: 'backing_off' in harness.states)
            assert now() - heard > 0.95 * TIMEOUT

    run(scenario())
