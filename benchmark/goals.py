# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The time of goals at the simulated arm of each profile, in virtual time.

Each plan is like a motion planner's (`trajectories.py`). At 50 % it has half of the velocity
limits and a quarter of the acceleration limits. The time is that of the motion, without the waits
around it.
"""

from dataclasses import replace

import numpy as np
from support.driver_harness import LIMITS, Harness, options_of, simulated

from benchmark.moves import Besides, main
from benchmark.trajectories import blended, fastest_timing, random_vias
from epson_driver.driver.smoothing import Smoothing
from epson_driver.motion import Trajectory, smooth
from epson_driver.setup.setup import make_setup

PROFILES = ('simulated', 'generic', 'motoman', 'rtmc', 'spel')
SPEEDS = (1.0, 0.5)
SPACINGS_S = (0.05, 0.1)
PLANS = 3
SEED = 20261129


def plans(speed: float, spacing: float) -> list[Trajectory]:
    """Return plans from the arm's initial position, at a fraction of the velocity limits."""
    random = np.random.default_rng(SEED)
    reach = 0.4 * np.minimum(LIMITS.position_max, -LIMITS.position_min).clip(0.2, 2.0)
    result = []
    for _ in range(PLANS):
        vias = random_vias(random, 4, -reach, reach)
        vias[0] = 0.0
        timed = fastest_timing(
            blended(vias, 0.2), speed * LIMITS.velocity, speed**2 * LIMITS.acceleration
        )
        times = np.append(np.arange(0.0, timed.duration - spacing / 2, spacing), timed.duration)
        result.append(Trajectory(LIMITS.names, times, timed.at(times)))
    return result


async def arm_time(name: str, plan: Trajectory, smoothing: Smoothing) -> float:
    """Return the duration of the arm's motion for a goal, s."""
    async with simulated(profile=name, smooth=True) as (controller, ports):
        options = options_of(name)  # type: ignore[no-untyped-call]
        async with Harness(ports, smoothing=smoothing, **options) as harness:
            await harness.ready()
            await harness.commands.enable()
            besides = Besides(controller)
            await besides.of(_end(harness, plan))
            return besides.motion


async def _end(harness: Harness, plan: Trajectory) -> None:
    outcome = await harness.execute(plan).end()  # type: ignore[no-untyped-call]
    if outcome.code.value:
        raise RuntimeError(outcome.text)


async def ratios(name: str, speed: float, smoothing: Smoothing) -> str:
    """Return the times of all plans at the arm / commanded, and / `smooth()`, as table cells."""
    commanded, best = [], []
    for spacing in SPACINGS_S:
        for plan in plans(speed, spacing):
            time = await arm_time(name, plan, smoothing)
            commanded.append(time / plan.duration)
            best.append(time / smooth(plan.positions, LIMITS).duration)
    return ' | '.join(f'{np.mean(each):.2f} (worst {max(each):.2f})' for each in (commanded, best))


async def measure(name: str) -> None:
    """Print a row for each speed, as planned and with timing = time_optimal."""
    usual = make_setup({'controller': name}).configuration.smoothing
    fastest = replace(usual, time_optimal=True)
    for speed in SPEEDS:
        cells = [await ratios(name, speed, smoothing) for smoothing in (usual, fastest)]
        print(f'| `{name}` | {speed:.0%} | {" | ".join(cells)} |', flush=True)


if __name__ == '__main__':
    main(measure, PROFILES, __doc__)
