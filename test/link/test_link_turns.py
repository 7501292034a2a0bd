# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A controller that sends without a pause: others in the event loop have their turn."""

import asyncio
import logging

from support.event_loop import run, stand_still, until
from support.link_harness import Harness, Peer, frame, joints

from epson_driver.link.connection import MAX_FRAMES_PER_TURN

MANY = 1000


def sends(data):
    async def talk(connection):
        await connection.send(data)
        await connection.stay()

    return talk


def test_others_have_their_turn_between_frames():
    async def scenario():
        async with Peer(sends(joints(1.0) * MANY)) as peer, Harness(peer.port) as harness:
            most, seen = 0, 0
            while seen < MANY:
                await asyncio.sleep(0)
                most, seen = max(most, len(harness.packets) - seen), len(harness.packets)
            assert 0 < most <= MAX_FRAMES_PER_TURN

    run(scenario())


def test_a_turn_of_others_is_no_silence():
    """What was received may take longer to handle than the link waits for more."""

    async def scenario():
        async with (
            Peer(sends(joints(1.0) * MANY)) as peer,
            Harness(peer.port, receive_timeout=0.5) as harness,
        ):
            while len(harness.packets) < MANY:
                if harness.packets:
                    _be_busy()
                await asyncio.sleep(0)
            assert 'backing_off' not in harness.states

    run(scenario())


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
