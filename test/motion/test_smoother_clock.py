# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The smoother follows irregular commanded times, neither early nor late."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from support.examples import one_in
from support.smoother_harness import ARM

from benchmark.exact_extrema import Recorded, exact_extrema
from benchmark.family_members import inside, splined
from benchmark.limit_sets import limit_set
from epson_driver.motion import Array, JointLimits
from epson_driver.motion.smoother import Mode, Smoother
from epson_driver.motion.smoother.request import ActivePlan

TOLERANCE_S, TOLERANCE_SHARE = 0.05, 0.02
"""Maximum time error at a point: s, and share of the trajectory's duration."""

STEP_S = 0.004

PASSAGE_STEP_S = 5e-4
"""Interval of linear interpolation for the passage of a knot, s."""


@dataclass(frozen=True, eq=False)
class Clocked:
    """Points of shape (k, n), and the time to each next one, shape (k - 1,), s."""

    positions: Array
    durations: Array
    limits: JointLimits

    @property
    def tolerance(self) -> float:
        """Maximum time error at a point, s."""
        return tolerance(float(self.durations.sum()))


def tolerance(commanded: float) -> float:
    """Return the maximum time error at a point of a trajectory of this duration, s."""
    return max(TOLERANCE_S, TOLERANCE_SHARE * commanded)


Change = Callable[[np.random.Generator, Array, Array], tuple[Array, Array]]
"""Turns positions and durations at an even pace into irregular ones."""


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
            offset = rng.uniform(-1.0, 1.0, len(position)) * rng.choice([0.0, 2.4e-4])
            points.append(position + offset)
            times.append(rng.uniform(0.001, 0.1))
    return np.array(points), np.array(times)


def _irregular(
    rng: np.random.Generator, positions: Array, durations: Array
) -> tuple[Array, Array]:
    """Select some points of an even motion, with steps of any size between them."""
    selected = np.flatnonzero(rng.random(len(positions)) < rng.choice([0.3, 0.7]))
    selected = np.union1d(selected, [0, len(positions) - 1])
    clock = np.append(0.0, np.cumsum(durations))
    return positions[selected], np.diff(clock[selected])


CLOCKS: dict[str, Change] = {
    'wrong': _wrong,
    'uneven': _uneven,
    'doubled': _doubled,
    'irregular': _irregular,
}
"""One step in eight 5 times too long, all times off by a factor, points repeated within 0.1 s
with up to 0.24 mrad of offset, and points of an even motion left out."""


def clocked(kind: str, seed: int) -> Clocked:
    """Return a random trajectory with irregular times that the joint velocities allow."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    limits = limit_set('full')
    poses = np.array([inside(rng, limits, 0.79) for _ in range(6)])
    positions = splined(poses, int(rng.integers(30, 110)))
    distances = np.max(np.abs(np.diff(positions, axis=0)) / limits.velocity, axis=1)
    durations = rng.uniform(6.0, 12.0) * np.maximum(distances, distances.mean())
    return Clocked(*CLOCKS[kind](rng, positions, durations), limits)


def off_the_clock(member: Clocked, known: float = np.inf) -> tuple[float, float]:
    """Return the largest time by which a point is passed too early, and too late, s.

    known: time span of known points ahead, s.
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
    """Return the largest time by which a point was passed too early, and too late, s.

    The times are those since the start of the motion. Points that are merged have the mean time.
    """
    passed: dict[int, float] = {}
    ends = [start for start, _ in smoother.executed[1:]] + [smoother.now]
    motion_start = np.nan
    for (start, what), end in zip(smoother.executed, ends, strict=True):
        if not isinstance(what, ActivePlan):
            continue
        motion_start = start if np.isnan(motion_start) else motion_start
        timing = what.timing
        count = int(timing.duration / PASSAGE_STEP_S) + 2
        times = np.linspace(0.0, timing.duration, count)
        us = np.maximum.accumulate(timing.sample(times)[0])
        for point, time in zip(
            what.route, what.start + np.interp(what.path.knots.u, us, times), strict=True
        ):
            if start <= time <= end and point.index > 0:
                passed.setdefault(point.index, float(time) - motion_start - point.clock)
    return -min(passed.values()), max(passed.values())


SEEDS = one_in(3, (101, 100, 102))
SHORT_S = 0.3
RUNS = [(kind, np.inf) for kind in CLOCKS]
RUNS += [(kind, SHORT_S) for kind in CLOCKS if kind != 'irregular']
"""Irregular points are seconds apart, so a short look-ahead has one point only."""


@pytest.mark.parametrize(('kind', 'known'), one_in(6, RUNS, several=True))
@pytest.mark.parametrize('seed', SEEDS)
def test_points_are_passed_near_their_time(kind: str, seed: int, known: float) -> None:
    member = clocked(kind, seed)
    early, late = off_the_clock(member, known)
    assert max(early, late) <= member.tolerance


def stepped(pace: float, catch_up: float) -> tuple[Recorded, float]:
    """Return a smoother after a start from rest, and its maximum speed.

    The speed is a multiple of the commanded one, which is constant.
    """
    smoother = Recorded(ARM, np.zeros(6), Mode.TIME_PRESERVING, catch_up=catch_up)
    for number in range(1, 60):
        smoother.append(np.full(6, 0.015 * number), 0.015 / pace)
    smoother.finish()
    fastest = 0.0
    while smoother.moving:
        motion = smoother.step(0.002)
        fastest = max(fastest, float(motion.velocity[0]) / pace)
    return smoother, fastest


@pytest.mark.parametrize('catch_up', [1.0, 1.2])
def test_delay_is_caught_up_at_most_at_the_configured_speed(catch_up: float) -> None:
    """A start from rest is late, and stays late with 1. The speed is a cost, no hard bound."""
    smoother, fastest = stepped(2.0, catch_up)
    assert catch_up - 0.1 < fastest <= 1.04 * catch_up
    assert exact_extrema(smoother, np.zeros(6)).worst <= 1.0 + 1e-6
    early, late = clock_errors(smoother)
    assert late >= -early


@pytest.mark.parametrize('catch_up', [0.99, np.nan, -1.0])
def test_invalid_catch_up_is_rejected(catch_up: float) -> None:
    with pytest.raises(ValueError, match=r'catch_up = .*: must be 1 or more'):
        Smoother(ARM, np.zeros(6), catch_up=catch_up)
