# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Task groups that end together, and waits for a fresh state."""

import asyncio

import pytest
from support.driver_harness import cell
from support.event_loop import now, stand_still

from epson_driver.driver.tasks import (
    Notification,
    TaskEndedError,
    run_task_group,
    wait_for_fresh_state,
)


@pytest.mark.invariant(9)
async def test_inv9_externally_cancelled_task_ends_the_group_with_an_error():
    ended = []

    async def cancelled():
        await asyncio.sleep(1.0)
        raise asyncio.CancelledError

    async def other():
        try:
            await asyncio.Event().wait()
        finally:
            ended.append('other')

    async def stop():
        ended.append('stop')

    with pytest.raises(TaskEndedError, match='state was cancelled'):
        await run_task_group({'state': cancelled, 'motion': other}, stop)
    assert ended == ['stop', 'other']  # the arm is stopped before the other tasks end


TIMEOUT_S = 0.2


@pytest.mark.invariant(6)
async def test_inv6_state_is_fresh_in_a_process_that_stalls_after_every_step():
    """The pose is judged at one earlier moment, and not when the process runs again."""
    async with cell() as (harness, _):
        robot = harness.driver.robot
        stalls = []

        def stale(moment):
            answer = robot.stale(moment)
            stand_still(0.5)  # between two lines
            stalls.append(now())
            return answer

        stand_still(1.0)
        moment = await wait_for_fresh_state(stale, harness.driver.changed, TIMEOUT_S)
        assert robot.why_not_ready(moment) is None
        stand_still(1.0)
        assert robot.why_not_ready(moment) is None
        assert stalls


@pytest.mark.invariant(6)
async def test_inv6_state_of_a_silent_controller_is_stale_after_the_timeout():
    silent_since = now() - 10.0
    moments = []

    def stale(moment):
        moments.append(moment)
        return moment - silent_since > 0.3

    start = now()
    moment = await wait_for_fresh_state(stale, Notification(), TIMEOUT_S)
    assert moment >= start + TIMEOUT_S
    assert stale(moment)
    assert moments[0] == start


async def test_message_in_the_socket_at_the_timeout_is_read():
    changed = Notification()
    newest = [now() - 10.0]

    async def reads_late():
        await asyncio.sleep(TIMEOUT_S)
        for _ in range(10):  # loop iterations from the socket to the driver
            await asyncio.sleep(0)
        newest[0] = now()

    task = asyncio.create_task(reads_late())
    moment = await wait_for_fresh_state(lambda at: at - newest[0] > 0.3, changed, TIMEOUT_S)
    assert moment - newest[0] < 0.3
    await task
