# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Parts of the driver that run together: what ends one ends all; waits for a fresh state."""

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
async def test_inv9_a_part_that_something_else_cancels_is_no_quiet_end():
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
    assert ended == ['stop', 'other']  # the arm is stopped while the others still run


PATIENCE_S = 0.2


@pytest.mark.invariant(6)
async def test_a_process_that_is_held_up_after_every_turn_still_finds_the_pose_fresh():
    """What came is judged as of a moment before, not as of when there was time to look."""
    async with cell() as (harness, _):
        robot, heard = harness.driver.robot, harness.driver.changed
        held_up = []

        def stale(moment):
            answer = robot.stale(moment)
            stand_still(0.5)  # between any two lines
            held_up.append(now())
            return answer

        stand_still(1.0)
        moment = await wait_for_fresh_state(stale, heard, PATIENCE_S)
        assert robot.why_not_ready(moment) is None
        stand_still(1.0)
        assert robot.why_not_ready(moment) is None
        assert held_up


@pytest.mark.invariant(6)
async def test_a_controller_that_is_silent_is_found_silent_after_the_patience():
    silent_since = now() - 10.0
    asked = []

    def stale(moment):
        asked.append(moment)
        return moment - silent_since > 0.3

    began = now()
    moment = await wait_for_fresh_state(stale, Notification(), PATIENCE_S)
    assert moment >= began + PATIENCE_S
    assert stale(moment)
    assert asked[0] == began


async def test_what_waits_in_the_socket_when_the_patience_is_over_is_read():
    heard = Notification()
    newest = [now() - 10.0]

    async def reads_late():
        await asyncio.sleep(PATIENCE_S)
        for _ in range(10):  # as many turns as it takes from the socket to the driver
            await asyncio.sleep(0)
        newest[0] = now()

    task = asyncio.create_task(reads_late())
    moment = await wait_for_fresh_state(lambda at: at - newest[0] > 0.3, heard, PATIENCE_S)
    assert moment - newest[0] < 0.3
    await task
