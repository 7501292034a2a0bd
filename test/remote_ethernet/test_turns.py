# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One dialogue at a time with the remote port, and the motors' first."""

import asyncio

import pytest
from support.event_loop import run

from epson_driver.remote_ethernet.turns import GaveWayError, RemoteTurns


async def forever():
    await asyncio.Event().wait()


def test_patient_dialogues_come_one_after_the_other_and_return_what_they_say():
    async def scenario():
        turns, said = RemoteTurns(), []

        async def dialogue(name):
            said.append(f'{name} begins')
            await asyncio.sleep(1.0)
            said.append(f'{name} ends')
            return name

        both = await asyncio.gather(*(turns.patient(lambda n=n: dialogue(n)) for n in 'ab'))
        assert both == ['a', 'b']
        assert said == ['a begins', 'a ends', 'b begins', 'b ends']

    run(scenario())


@pytest.mark.invariant(3)
def test_an_urgent_dialogue_breaks_a_patient_one_off_and_those_that_wait_do_not_go_first():
    async def scenario():
        turns, order = RemoteTurns(), []

        async def waiting():
            order.append('a patient one')

        running = asyncio.create_task(turns.patient(forever))
        await asyncio.sleep(0.1)
        next_one = asyncio.create_task(turns.patient(waiting))
        await asyncio.sleep(0.1)
        async with turns.urgent():
            order.append('urgent')
            with pytest.raises(GaveWayError, match='needed for the motors'):
                await running
        with pytest.raises(GaveWayError):
            await next_one
        assert order == ['urgent']
        assert await turns.patient(say) == 'again'

    async def say():
        return 'again'

    run(scenario())


def test_who_is_cancelled_frees_the_port_and_what_is_raised_comes_through():
    async def scenario():
        turns = RemoteTurns()
        running = asyncio.create_task(turns.patient(forever))
        await asyncio.sleep(0.1)
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running

        async def fail():
            raise ZeroDivisionError

        with pytest.raises(ZeroDivisionError):
            await turns.patient(fail)
        async with asyncio.timeout(1.0), turns.urgent():
            pass

    run(scenario())
