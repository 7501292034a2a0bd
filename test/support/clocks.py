# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Trajectories with irregular times, and how far from its time a smoother passes each point."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmark.exact_extrema import Recorded
from benchmark.family_members import inside, splined
from benchmark.limit_sets import limit_set
from epson_driver.motion import Array, JointLimits
from epson_driver.motion.smoother import Mode
from epson_driver.motion.smoother.request import ActivePlan

TOLERANCE_S, TOLERANCE_SHARE = 0.05, 0.02
"""How far from its commanded time a point may be passed: s, or of the trajectory's time."""

STEP_S = 0.004

PASSAGE_STEP_S = 5e-4
"""Between this, s, the passage of a knot is looked for by straight lines."""


@dataclass(frozen=True, eq=False)
class Clocked:
    """Points of shape (k, n), how long each way to the next should take, shape (k - 1,), s."""

    positions: Array
    durations: Array
    limits: JointLimits

    @property
    def tolerance(self) -> float:
        """How far from its time a point may be passed, s."""
        return tolerance(float(self.durations.sum()))


def tolerance(commanded: float) -> float:
    """Return how far from its time a point of so long a trajectory may be passed, s."""
    return max(TOLERANCE_S, TOLERANCE_SHARE * commanded)


Change = Callable[[np.random.Generator, Array, Array], tuple[Array, Array]]
"""From positions and durations at an even pace to irregular ones."""


def _wrong(rng: np.random.Generator, positions: Array, durations: Array) -> tuple[Array, Array]:
    slow = rng.choice(len(durations), max(1, len(durations) // 8), replace=False)
    durations[slow] *= 5.0
    return positions, durations


def _uneven(rng: np.random.Generator, positions: Array, durations: Array) -> tuple[Array, Array]:
    return positions, durations * np.exp(rng.normal(0.0, 0.5, len(durations)))


def _doubled(rng: np.random.Generator, positions: Array, durations: Array) -> tuple[Array, Array]:
    points, times = [positions[0]], []
    for position, duration in zip(positions[1:], durations.tolist(), strict=True):
        points.append(position)
        times.append(duration)
        if rng.random() < 0.3:
            beside = rng.uniform(-1.0, 1.0, len(position)) * rng.choice([0.0, 2.4e-4])
            points.append(position + beside)
            times.append(rng.uniform(0.001, 0.1))
    return np.array(points), np.array(times)


def _irregular(
    rng: np.random.Generator, positions: Array, durations: Array
) -> tuple[Array, Array]:
    """Some points of an even motion, with steps of any size between them."""
    kept = np.flatnonzero(rng.random(len(positions)) < rng.choice([0.3, 0.7]))
    kept = np.union1d(kept, [0, len(positions) - 1])
    clock = np.append(0.0, np.cumsum(durations))
    return positions[kept], np.diff(clock[kept])


CLOCKS: dict[str, Change] = {
    'wrong': _wrong,
    'uneven': _uneven,
    'doubled': _doubled,
    'irregular': _irregular,
}
"""One step in eight 5 times too long; all times off by a factor; points that come twice within
0.1 s, up to 0.24 mrad beside; and points of an even motion that are left out."""


def clocked(kind: str, seed: int) -> Clocked:
    """Return a random trajectory with irregular times that leave the joints time enough."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    limits = limit_set('full')
    poses = np.array([inside(rng, limits, 0.79) for _ in range(6)])
    positions = splined(poses, int(rng.integers(30, 110)))
    ways = np.max(np.abs(np.diff(positions, axis=0)) / limits.velocity, axis=1)
    durations = rng.uniform(6.0, 12.0) * np.maximum(ways, ways.mean())
    return Clocked(*CLOCKS[kind](rng, positions, durations), limits)


def off_the_clock(member: Clocked, known: float = np.inf) -> tuple[float, float]:
    """Return how much too early a point is passed at most, and how much too late, s.

    known: how much is known ahead, s.
    """
    smoother = Recorded(member.limits, member.positions[0], Mode.TIME_PRESERVING)
    fed = 1
    while fed < len(member.positions) or smoother.moving:
        while fed < len(member.positions) and smoother.look_ahead < known:
            smoother.append(member.positions[fed], float(member.durations[fed - 1]))
            fed += 1
            if fed == len(member.positions):
                smoother.finish()
        smoother.step(STEP_S)
    return clock_errors(smoother)


def clock_errors(smoother: Recorded) -> tuple[float, float]:
    """Return how much too early a point was passed at most, and how much too late, s.

    By the times of the points from where the motion began. Of points that count as one, the time
    is in the middle.
    """
    passed: dict[int, float] = {}
    ends = [begin for begin, _ in smoother.executed[1:]] + [smoother.now]
    began = np.nan
    for (begin, what), end in zip(smoother.executed, ends, strict=True):
        if not isinstance(what, ActivePlan):
            continue
        began = begin if np.isnan(began) else began
        timing = what.timing
        count = int(timing.duration / PASSAGE_STEP_S) + 2
        times = np.linspace(0.0, timing.duration, count)
        us = np.maximum.accumulate(timing.sample(times)[0])
        for point, time in zip(
            what.route, what.begin + np.interp(what.path.knots.u, us, times), strict=True
        ):
            if begin <= time <= end and point.index > 0:
                passed.setdefault(point.index, float(time) - began - point.clock)
    return -min(passed.values()), max(passed.values())
