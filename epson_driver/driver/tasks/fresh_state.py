# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""When to judge whether the pose is fresh, however busy the machine is.

A pose is old if nothing newer has come, not if this process was held up before it could look. So
its age is counted to a moment by which everything that had come was read for certain: what is told
about that moment stays true when the process is held up afterwards.
"""

import asyncio
import contextlib
from collections.abc import Callable

from epson_driver.driver.tasks.notification import Notification
from epson_driver.link.receive_timeout import READING_TURNS

MAX_READING_TURNS = 100
"""Turns of the event loop that are given to reading in the end: 5000 state messages, which take
25 s to come. If there is nothing to read, they take about a millisecond."""


async def wait_for_fresh_state(
    stale: Callable[[float], object], heard: Notification, patience: float
) -> float:
    """Wait for a fresh state, and return the loop's time at which to judge it, s.

    The first at which `stale` does not hold, after `patience` s otherwise the last. `heard` is
    notified when something came.
    """
    loop = asyncio.get_running_loop()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(patience):
            while True:
                moment = loop.time()
                if await _read_by(moment, stale, READING_TURNS):
                    return moment
                await heard.wait()
    moment = loop.time()
    await _read_by(moment, stale, MAX_READING_TURNS)
    return moment


async def _read_by(moment: float, stale: Callable[[float], object], turns: int) -> bool:
    """Let pending input be read, and return whether the state is fresh at a moment."""
    for _ in range(turns):
        if not stale(moment):
            return True
        await asyncio.sleep(0)
    return not stale(moment)
