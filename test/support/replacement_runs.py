# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals that replace each other in mid-motion: driver and smooth controller, in virtual time.

What the arm commanded is recorded as it was executed, so its extrema are exact.
"""

import asyncio
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from benchmark.exact_extrema import Recorded, exact_extrema
from epson_driver.driver.goal.goal import Goal
from epson_driver.motion import Trajectory
from epson_driver.motion.smoother.active_plan import ActivePlan
from epson_driver.sim_controller.arm import streaming
from support.driver_harness import HOME, JOINTS, LIMITS, Submitted, cell
from support.event_loop import now, until
from support.streaming_harness import way

DT = 1e-3
STANDS = 1e-4
"""An arm is slow below this share of each velocity limit."""

ACCELERATES = 0.05
"""And turns round rather than stands above this share of an acceleration limit."""


@dataclass
class Replacement:
    """What a replacement at one moment came to. Times in s."""

    old: str
    new: str
    took: float
    """From the submission of the new goal to its end."""
    there: float
    """From then until the arm stands, as it was commanded to."""
    planned: float
    """How long the new goal is."""
    rests: int
    """Rests from then on, but for the last one."""
    worst: float
    """The largest multiple of a limit, by the exact extrema; a jump counts, too."""
    joined: int
    off: float
    """How far from the new goal's end the arm stands, rad."""


def goal(times, positions, tolerance=0.01):
    times, positions = np.asarray(times, dtype=float), np.atleast_2d(positions)
    trajectory = Trajectory(LIMITS.names, times, positions)
    return Goal(trajectory, np.full(JOINTS, tolerance), goal_time=0.0)


def long_way(kind, seconds=2.5):
    """Return a goal from HOME: 'dense', every 20 ms; 'planned', every 100 ms; 'one' point."""
    if kind == 'one':
        return goal([seconds], way(2)[1:])
    count = round(seconds / {'dense': 0.02, 'planned': 0.1}[kind]) + 1
    return goal(np.linspace(0.0, seconds, count), way(count))


AHEAD = 0.5
"""A plan for an arm in motion begins where that is so much later, s."""


def new_goal(kind, rng, old, time):
    """Return a goal for an arm that is at a time of the plan `old`, s.

    'one' point somewhere, a 'curve' there from where it will be, or 'again': what is left of the
    old one, to a place up to 0.2 rad beside its end.
    """
    ahead = time + AHEAD
    here = _at(old, np.array([ahead]))[0]
    if kind == 'again':
        left = np.arange(ahead, max(old.duration, ahead + 0.2), 0.1)
        left = np.append(left, left[-1] + 0.1)
        aside = ((left - ahead) / (left[-1] - ahead))[:, None] ** 2
        offset = rng.uniform(-0.2, 0.2, JOINTS)
        return goal(left - time, _at(old, left) + aside * offset)
    share = rng.uniform(0.3, 0.7, JOINTS)
    end = LIMITS.position_min * (1.0 - share) + LIMITS.position_max * share
    end = here + (end - here) * min(1.0, 0.8 / np.abs(end - here).max())
    seconds = 2.0 * float(np.max(np.abs(end - here) / LIMITS.velocity)) + rng.uniform(0.3, 1.0)
    if kind == 'one':
        return goal([seconds], end)
    count = round(seconds / 0.1)
    left = 1.0 - np.linspace(0.0, 1.0, count + 1)[1:, None]
    return goal(AHEAD + 0.1 * np.arange(count), end + (here - end) * left**3)


def _at(plan, times):
    """Return where a plan from HOME is at times, shape (k,), s, straight between its points."""
    known = np.concatenate([[0.0], plan.times])
    positions = np.vstack([HOME, plan.positions])
    return np.stack([np.interp(times, known, column) for column in positions.T], axis=1)


async def _run(patch, old, new_kind, moment, rng, on_the_way, planner):
    executors = []
    placed = streaming.Smoother  # type: ignore[attr-defined]

    def recorded(*args, **named):
        executors.append(Recorded(*args, **named))
        return executors[-1]

    patch.setattr(streaming, 'Smoother', recorded)
    async with cell(smooth=planner, on_the_way=on_the_way) as (harness, _):
        patch.setattr(streaming, 'Smoother', placed)
        queue = harness.driver.goal_queue
        first = Submitted(old)
        queue.submit(first.handle)
        await until(lambda: first.handle.execution is not None)
        await asyncio.sleep(moment)
        execution: Any = first.handle.execution
        time = execution.desired[0]
        second = Submitted(new_goal(new_kind, rng, old.trajectory, time))
        since, begun = executors[-1].now, now()
        queue.submit(second.handle)
        outcome = await second.end()
        assert second.ended_at is not None
        took = second.ended_at - begun
        trajectory = second.handle.goal.trajectory
        off = float(np.abs(harness.at - trajectory.positions[-1]).max())
        smoother = executors[-1]
        there = max(begin for begin, what in smoother.executed if what is None) - since
        found = exact_extrema(smoother, HOME)
        jumps = (found.velocity_jump, found.acceleration_jump)
        worst = max(found.worst, 1.0 + found.outside, 1.0 + max(*jumps, found.position_jump))
        return Replacement(
            first.outcome.text,
            f'{outcome.end.value}: {outcome.text}',
            took,
            there,
            trajectory.duration,
            rests(smoother, since),
            worst,
            queue.joined,
            off,
        )


async def replacement(
    patch: Any,
    seed: int,
    *,
    on_the_way: bool,
    old: str | None = None,
    new: str | None = None,
    planner: Any = True,
) -> Replacement:
    """Replace a goal at a random moment; `seed` tells which goals, and when, s.

    `planner`: the controller's, if planning takes time.
    """
    rng = np.random.default_rng([seed, 17])
    old = old or str(rng.choice(['dense', 'planned', 'one']))
    new = new or str(rng.choice(['one', 'curve', 'again']))
    moment = float(rng.uniform(0.15, 2.3))
    return await _run(patch, long_way(old), new, moment, rng, on_the_way, planner)


def rests(smoother, since):
    """Return how often the arm came to rest after a time of the smoother, but for the last."""
    states = [_stands(smoother, time) for time in np.arange(since, smoother.now, DT)]
    while states and states[-1]:
        states.pop()
    return sum(stands and not before for before, stands in pairwise(states))


def _stands(smoother, time):
    begins = [begin for begin, _ in smoother.executed]
    begin, what = smoother.executed[int(np.searchsorted(begins, time, side='right')) - 1]
    if what is None:
        return True
    if isinstance(what, ActivePlan):
        u, v, a = what.timing.at(time - what.begin)
        _, first, second = what.path.at(u)
        velocity, acceleration = first * v, first * a + second * v * v
    else:
        _, velocity, acceleration = what.at(time - begin)
    return bool(
        np.all(np.abs(velocity) < STANDS * LIMITS.velocity)
        and np.all(np.abs(acceleration) < ACCELERATES * LIMITS.acceleration)
    )
