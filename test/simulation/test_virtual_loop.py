# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The order of events in a world is the order of its timers."""

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
def test_consequences_of_a_timer_precede_the_next_timer_of_that_time(turns):
    async def scenario():
        loop, seen = asyncio.get_running_loop(), []

        async def follow(name):
            for _ in range(turns):  # Python versions differ in their number
                await asyncio.sleep(0)
            seen.append((name, loop.time()))

        when = loop.time() + 1.0
        for name in ('first', 'second'):
            loop.call_at(when, lambda name=name: asyncio.create_task(follow(name)))
        await asyncio.sleep(2.0)
        return seen, when

    seen, when = run(scenario())
    assert seen == [('first', when), ('second', when)]


def test_endless_callbacks_are_reported(monkeypatch):
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
def test_clock_drift_affects_one_process_only(rate):
    async def scenario():
        loop, seen = asyncio.get_running_loop(), []

        async def sleep_twice():
            for _ in range(2):
                start = loop.time()
                await asyncio.sleep(1.0)
                seen.append((loop.time() - start, loop.now - START_S))

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


def test_remaining_tasks_end_in_the_order_of_their_start():
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
