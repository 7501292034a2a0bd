# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals whose speed is scaled on the way, and how fast the arm was on them."""

import asyncio

import numpy as np

from epson_driver.driver.outcome import End
from support.driver_harness import Submitted, pose
from support.event_loop import now
from support.replacement_runs import long_way


def submit(harness, some_goal):
    submitted = Submitted(some_goal)
    harness.driver.goal_queue.submit(submitted.handle)
    return submitted


def scale(harness, factor):
    harness.driver.goal_queue.scaling.set(factor, now())


def progress(harness, plan, since):
    """Return when samples were, and where the arm was on its plan then, s, since a time."""
    fine = np.linspace(0.0, plan.duration, 2001)
    known = np.concatenate([[0.0], plan.times]) if plan.times[0] else plan.times
    rows = plan.positions if len(known) == len(plan.times) else np.vstack([pose(), plan.positions])
    way = np.stack([np.interp(fine, known, column) for column in rows.T], axis=1)
    found = [(at, each.positions) for at, each in harness.events.samples if at >= since]
    places = [fine[np.abs(way - position).max(axis=1).argmin()] for _, position in found]
    return np.array([at for at, _ in found]) - since, np.array(places)


def pace(times, places, begin, end):
    """Return the mean pace between two times."""
    inside = (times >= begin) & (times <= end)
    return float(np.polyfit(times[inside], places[inside], 1)[0])


async def slowed_on_the_way(cell, seed):
    """Return a share that a goal was slowed down to, and `progress` from then until near its end.

    Share, moment and goal are drawn.
    """
    rng = np.random.default_rng(seed)
    share, moment = float(rng.uniform(0.15, 0.6)), float(rng.uniform(0.3, 1.2))
    way = long_way(str(rng.choice(['dense', 'planned'])), 3.0)
    async with cell as (harness, _):
        first = submit(harness, way)
        await harness.until_moving()
        await asyncio.sleep(moment)
        scale(harness, share)
        since = now()
        assert (await first.end()).end is End.SUCCEEDED
        times, places = progress(harness, way.trajectory, since)
    assert np.all(np.diff(places) > -0.01)
    inside = places < 2.8
    return share, times[inside], places[inside]
