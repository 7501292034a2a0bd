# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A share of the speeds is an upper bound, whenever it is set, in every mode.

Invariant 2 of docs/invariants.md.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
from support.examples import quickly
from support.smoother_harness import ARM, SLOW

from benchmark.exact_extrema import Recorded, exact_extrema
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.motion.passages import passed
from epson_driver.motion.smoother import Mode
from epson_driver.motion.smoother.limit_usage import limit_usage
from epson_driver.motion.smoother.share_ramp import shortest

pytestmark = pytest.mark.invariant(2)

DT = 0.004
LONGEST_RAMP_S = 1.5
"""With these limits, in which a stop takes 0.2 s."""

RECEDING_HORIZON_SHARE = 0.02
"""By how much one time-optimal motion through the same points may be faster than another one that
was planned at other moments."""


@dataclass
class Run:
    """A motion through points, and when it was at its share at last."""

    smoother: Recorded
    motion: Trajectory
    settled: float


def circle(pace: float) -> tuple[Array, list[float]]:
    """Return points on a way round, and durations, in times of what full speed needs."""
    angle = np.linspace(0.0, 4.0, 60)
    points = np.zeros((60, 6))
    points[:, 0], points[:, 1] = np.cos(angle) - 1.0, 0.4 * np.sin(angle)
    points[:, 3], points[:, 5] = 0.8 * np.sin(1.7 * angle), 1.2 * np.sin(angle)
    ways = np.max(np.abs(np.diff(points, axis=0)) / ARM.velocity, axis=1)
    return points, (pace * ways).tolist()


def run(
    points: Array,
    durations: list[float],
    mode: Mode,
    shares: list[tuple[float, float]],
    limits: JointLimits = ARM,
    latency: float = 0.0,
) -> Run:
    """Set shares at times, and return what the motion was."""
    smoother = Recorded(limits, points[0], mode, latency=latency)
    for point, duration in zip(points[1:], durations, strict=True):
        smoother.append(point, duration)
    smoother.finish()
    rows = [smoother.motion]
    coming, settled = list(shares), 0.0
    while smoother.moving:
        while coming and smoother.now >= coming[0][0]:
            smoother.scale = coming.pop(0)[1]
        rows.append(smoother.step(DT))
        assert smoother.now < 60.0
        on_the_way = 0 < smoother.points_ahead < len(points) - 1
        assert not (smoother.at_rest and on_the_way)
        _, executed = smoother.executed[-1]
        scale = getattr(executed, 'scale', smoother.scale)
        if scale != smoother.scale or getattr(executed, 'settled', 0.0) > smoother.now:
            settled = smoother.now
    q, v, a = (np.array(column) for column in zip(*rows, strict=True))
    return Run(smoother, Trajectory(limits.names, DT * np.arange(len(rows)), q, v, a), settled)


def times(points: Array, done: Run) -> Array:
    """Return when a motion passes the points."""
    found: Array = passed(points, done.motion)[1]
    return found


@pytest.mark.parametrize(
    ('share', 'latency'),
    quickly([(0.3, 0.05)], product([0.9, 0.3, 0.05], [0.0, 0.05])),
)
@pytest.mark.parametrize(
    ('mode', 'pace'),
    [(Mode.TIME_PRESERVING, 6.0), (Mode.TIME_PRESERVING, 1.0), (Mode.TIME_OPTIMAL, 1.0)],
)
def test_no_point_is_passed_sooner_with_a_share_that_is_set_in_motion(
    mode: Mode, pace: float, share: float, latency: float
) -> None:
    points, durations = circle(pace)
    free = run(points, durations, mode, [], latency=latency)
    at = 0.35 * free.smoother.now
    slower = run(points, durations, mode, [(at, share)], latency=latency)
    exact = exact_extrema(slower.smoother, points[0])
    assert exact.worst <= 1.0 + 1e-6, exact
    assert slower.smoother.violations == slower.smoother.planner_errors == 0
    assert np.max(np.abs(slower.motion.positions[-1] - points[-1])) < 1e-9
    before, after = times(points, free), times(points, slower)
    luck = RECEDING_HORIZON_SHARE if mode is Mode.TIME_OPTIMAL or pace == 1.0 else 0.0
    assert np.all(after >= before * (1.0 - luck) - DT)
    # after the ramp every way takes what the share makes of it
    assert slower.settled - at < LONGEST_RAMP_S
    reached = int(np.searchsorted(after, slower.settled)) + 1
    if reached < len(points) - 1:
        rest = after[-1] - after[reached]
        assert rest >= (before[-1] - before[reached]) / share * (0.99 - 10.0 * luck)


@pytest.mark.parametrize('mode', list(Mode))
def test_shares_that_change_all_the_time(mode: Mode) -> None:
    points, durations = circle(3.0)
    rng = np.random.default_rng(1)
    shares = [(0.06 * number, float(rng.uniform(0.1, 1.0))) for number in range(40)]
    done = run(points, durations, mode, [*shares, (2.4, 1.0)], latency=0.02)
    assert exact_extrema(done.smoother, points[0]).worst <= 1.0 + 1e-6
    assert done.smoother.violations == 0


def test_a_share_from_a_pause_on() -> None:
    points, durations = circle(3.0)
    done = run(points, durations, Mode.TIME_PRESERVING, [(0.0, 0.5)])
    free = run(points, durations, Mode.TIME_PRESERVING, [])
    assert done.smoother.now == pytest.approx(2.0 * free.smoother.now, rel=0.01)


@pytest.mark.parametrize('share', [0.0, 0.1])
def test_a_replacement_keeps_to_the_share(share: float) -> None:
    smoother = Recorded(SLOW, np.zeros(3))
    smoother.append(np.full(3, 1.0))
    smoother.scale = share or 1.0
    while smoother.points_ahead and smoother.now < 0.5:
        smoother.step(DT)
    smoother.scale = share
    while not (smoother.at_rest or share):
        smoother.step(DT)
    smoother.replace(np.array([[-1.0, -1.0, -1.0], [-1.5, -1.0, -1.0]]))
    fastest = 0.0
    for _ in range(400):
        fastest = max(fastest, float(np.max(np.abs(smoother.step(DT).velocity) / SLOW.velocity)))
    assert fastest <= share * (1.0 + 1e-9) + (1e-9 if share else 0.0)
    assert smoother.violations == 0


@pytest.mark.parametrize('ratio', [0.9, 0.5, 0.1, 0.02])
def test_a_ramp_is_the_same_motion_at_another_pace(ratio: float) -> None:
    points, durations = circle(3.0)
    smoother = Recorded(ARM, points[0])
    for point, duration in zip(points[1:], durations, strict=True):
        smoother.append(point, duration)
    smoother.finish()
    while smoother.now < 0.3:
        smoother.step(DT)
    _, plan = smoother.executed[-1]
    left = plan.timing.part(smoother.now - plan.begin)
    found = shortest(plan.path, left, ratio, ARM, 0.0)
    assert found is not None
    slower, settled = found
    assert limit_usage(plan.path, slower, ARM).allowed
    ts = np.linspace(0.0, left.duration, 2000)
    assert np.all(slower.sample(ts)[0] <= left.sample(ts)[0] + 1e-12)
    # after the ramp: where the plan is when as much of its time has passed, at the share
    u, v, _ = slower.at(settled + 0.05)
    when = float(np.interp(u, left.sample(ts)[0], ts))
    assert v == pytest.approx(ratio * left.at(when)[1], rel=1e-3)
    assert slower.end == left.end
