# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The order of a world is that of its timers, whatever passes on what has happened."""

import asyncio

import pytest

from simulation import virtual_loop
from simulation.network import Network
from simulation.virtual_loop import NothingLeftError, VirtualLoop


def run(scenario):
    loop = VirtualLoop(Network(lambda: 0.01))
    try:
        return loop.run_until_complete(scenario)
    finally:
        loop.bury()


@pytest.mark.parametrize('turns', [0, 1, 7])
def test_what_follows_from_a_timer_happens_before_the_next_one_at_the_same_time(turns):
    async def scenario():
        loop, seen = asyncio.get_running_loop(), []

        async def follow(name):
            for _ in range(turns):  # another Python needs more of them
                await asyncio.sleep(0)
            seen.append((name, loop.time()))

        when = loop.time() + 1.0
        for name in ('first', 'second'):
            loop.call_at(when, lambda name=name: asyncio.create_task(follow(name)))
        await asyncio.sleep(2.0)
        return seen, when

    seen, when = run(scenario())
    assert seen == [('first', when), ('second', when)]


def test_a_task_that_spins_is_said(monkeypatch):
    monkeypatch.setattr(virtual_loop, 'MAX_CALLS', 100)

    async def scenario():
        loop = asyncio.get_running_loop()

        def again():
            loop.call_soon(again)

        again()
        await asyncio.sleep(1.0)

    with pytest.raises(NothingLeftError, match='comes for ever'):
        run(scenario())


def test_what_is_left_ends_in_the_order_in_which_it_began():
    ended = []

    async def wait(number):
        try:
            await asyncio.Event().wait()
        finally:
            ended.append(number)

    async def scenario():
        tasks = [asyncio.create_task(wait(number)) for number in range(50)]
        await asyncio.sleep(1.0)
        return tasks

    run(scenario())
    assert ended == list(range(50))
