# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The order of a world is that of its timers, whatever passes on what has happened."""

import asyncio
from contextvars import copy_context

import pytest

from simulation import virtual_loop
from simulation.network import PROCESS, Network
from simulation.virtual_loop import START_S, NothingLeftError, VirtualLoop


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

    with pytest.raises(NothingLeftError, match='repeats forever'):
        run(scenario())


@pytest.mark.parametrize('rate', [0.5, 1.0, 2.0])
def test_a_clock_that_drifts_is_its_processs_own(rate):
    async def scenario():
        loop, seen = asyncio.get_running_loop(), []

        async def sleep_twice():
            for _ in range(2):
                begun = loop.time()
                await asyncio.sleep(1.0)
                seen.append((loop.time() - begun, loop.now - START_S))

        drifting = copy_context()
        drifting.run(PROCESS.set, 'controller')
        task = drifting.run(asyncio.create_task, sleep_twice())
        await asyncio.sleep(0.0)
        loop.drift('controller', rate)  # its first timer was set before
        await asyncio.sleep(10.0)
        assert loop.time() == START_S + 10.0
        await task
        assert drifting.run(loop.time) == pytest.approx(START_S + 10.0 * rate)
        return seen

    first, second = run(scenario())
    assert first == pytest.approx((rate, 1.0))
    assert second == pytest.approx((1.0, 1.0 + 1.0 / rate))


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
