# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Parts of the driver that run together: what ends one of them ends all, and is told."""

import asyncio

import pytest
from support.event_loop import run

from epson_driver.driver.tasks.task_group import TaskEndedError, run_task_group


@pytest.mark.invariant(9)
def test_inv9_a_part_that_something_else_cancels_is_no_quiet_end():
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

    async def check():
        with pytest.raises(TaskEndedError, match='state was cancelled'):
            await run_task_group({'state': cancelled, 'motion': other}, stop)

    run(check())
    assert ended == ['stop', 'other']  # the arm is stopped while the others still run
