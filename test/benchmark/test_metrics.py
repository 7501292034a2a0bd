# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The metrics of the benchmark, its trajectories and its requirements."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from benchmark.baselines import joint_spline, stop_and_go
from benchmark.limit_sets import FACTORS, limit_set
from benchmark.metrics import Metrics, measure, stops
from benchmark.motion_record import Record
from benchmark.references import References, digest
from benchmark.strategies import SAMPLE_STEP_S
from benchmark.trajectories import BenchmarkTrajectory, benchmark_set
from benchmark.waypoints import may_be_merged, waypoint_passages
from epson_driver.motion import Array, go

LIMITS = limit_set('full')
POINTS = np.array([[0.0, -0.5, 0.5, 0.0, -1.0, 0.0]] * 5)
POINTS[:, 0] = [0.0, 0.3, 0.1, 0.6, 0.5]
POINTS[:, 5] = [0.0, -0.2, 0.4, 0.8, 1.2]


def stops_at_each(positions: Array = POINTS) -> Record:
    """Return samples of the fastest moves from rest to rest at every point."""
    rows = [np.concatenate([positions[0], np.zeros(2 * positions.shape[1])])]
    for start, target in pairwise(positions):
        motion = go(LIMITS, start, target)
        times = np.arange(SAMPLE_STEP_S, motion.duration, SAMPLE_STEP_S)
        rows += [np.concatenate(motion.at(time)) for time in times.tolist()]
        rows += 3 * [np.concatenate([target, np.zeros(2 * len(target))])]
    position, velocity, acceleration = np.split(np.array(rows), 3, axis=1)
    none = np.zeros(0)
    return Record(SAMPLE_STEP_S, position, velocity, acceleration, none, none.astype(np.bool_))


def figures_of(
    record: Record, positions: Array = POINTS, durations: Array | None = None
) -> Metrics:
    """Return the figures of a motion along points. With durations the points are commanded."""
    return measure(
        BenchmarkTrajectory('a test', positions, durations),
        record,
        LIMITS,
        timed=durations is not None,
    )


def test_figures_of_stop_and_go_motion_are_exact() -> None:
    expected = stop_and_go(POINTS, LIMITS)
    figures = figures_of(stops_at_each())
    assert figures.duration == pytest.approx(expected.duration, abs=0.02)
    assert figures.stops == expected.stops == 3
    assert figures.jerk == pytest.approx(1.0, abs=1e-3)
    assert figures.acceleration <= 1.0 + 1e-9
    assert figures.waypoint < 1e-6
    assert figures.mismatch < 5e-3
    assert figures.overrun == figures.end == 0.0


def test_only_uncommanded_rests_are_stops() -> None:
    positions = np.repeat(POINTS, [1, 1, 2, 1, 1], axis=0)
    record = stops_at_each(positions)
    durations = np.array([0.0, 0.3, 0.3, 0.5, 0.3, 0.3])
    assert figures_of(record, positions, durations).stops == 2
    assert figures_of(record, positions).stops == 3


def test_overrun_is_measured() -> None:
    record = stops_at_each(np.concatenate([POINTS, [POINTS[-1] + 0.01], POINTS[-1:]]))
    figures = figures_of(record)
    assert figures.overrun == pytest.approx(0.01, abs=1e-6)
    assert figures.end == 0.0


def test_missed_waypoint_is_measured() -> None:
    missed = POINTS.copy()
    missed[2, 3] += 3e-3
    assert figures_of(stops_at_each(), missed).waypoint == pytest.approx(3e-3, rel=1e-3)


def test_early_waypoint_is_measured() -> None:
    record = stops_at_each()
    late = np.diff(waypoint_passages(POINTS, record).times, prepend=0.0)
    late[2] += 0.25
    assert figures_of(record, POINTS, late).early == pytest.approx(0.25)
    assert figures_of(record).early == 0.0


def test_merged_waypoint_has_the_tolerance() -> None:
    beside = POINTS[2] + np.array([0.0, 0.0, 0.0, 4e-4, 0.0, 0.0])
    positions = np.insert(POINTS, 3, beside, axis=0)
    assert may_be_merged(positions, 5e-4).tolist() == [False, False, False, True, False, False]
    assert figures_of(stops_at_each(), positions).waypoint < 1e-6


def test_passage_between_two_samples_has_its_exact_time_and_distance() -> None:
    motion = go(LIMITS, POINTS[0], POINTS[1])
    times = np.linspace(0.0213, motion.duration - 0.0211, 37)
    passed = waypoint_passages(
        np.array([motion.at(time)[0] for time in times]), stops_at_each(POINTS[:2])
    )
    assert passed.distances.max() < 1e-6
    assert passed.times == pytest.approx(times, abs=1e-5)


def test_inconsistent_derivatives_are_measured() -> None:
    record = stops_at_each()
    wrong = replace(record, velocities=1.1 * record.velocities)
    assert figures_of(wrong).mismatch > 0.01
    accelerations = record.accelerations.copy()
    accelerations[100:, 2] += 0.05 * LIMITS.acceleration[2]
    assert figures_of(replace(record, accelerations=accelerations)).jerk > 4.9


def slow_samples(acceleration: Array, phase: float) -> Record:
    """Return samples of one joint with these accelerations, `phase` s off the millisecond.

    acceleration: as shares of the limit, at -30 … 30 ms of a moment at which nothing moves.
    """
    fine = np.arange(-0.03, 0.03, 1e-5)
    a = np.interp(fine, np.linspace(-0.03, 0.03, len(acceleration)), acceleration)
    a *= LIMITS.acceleration[0]
    v = np.cumsum(a) * 1e-5
    v -= np.interp(0.0, fine, v)
    times = np.arange(-0.029, 0.029, SAMPLE_STEP_S) + phase
    zeros = np.zeros((len(times), len(LIMITS.names)))
    velocities, accelerations = zeros.copy(), zeros.copy()
    velocities[:, 0] = np.interp(times, fine, v)
    accelerations[:, 0] = np.interp(times, fine, a)
    none = np.zeros(0)
    return Record(SAMPLE_STEP_S, zeros, velocities, accelerations, none, none.astype(np.bool_))


@pytest.mark.parametrize('phase', [0.0, 2e-4, 5e-4, 8e-4])
@pytest.mark.parametrize(
    ('accelerations', 'found'),
    [
        ([0.012, 0.012], 0),
        ([0.02, 0.01, 0.02], 0),
        ([0.3, 0.0, 0.3], 1),
        ([-0.3, 0.0, 0.3], 1),
        ([0.1, 0.0, 0.0, 0.0, 0.1], 1),
    ],
    ids=['a slow turn', 'a turn', 'a rest, and back', 'a rest, and on', 'a longer rest'],
)
def test_reversal_is_no_stop(accelerations: list[float], found: int, phase: float) -> None:
    record = slow_samples(np.array(accelerations), phase)

    assert len(stops(record, LIMITS)) == found


def test_stored_references_are_complete_and_valid() -> None:
    stored = References()
    for one in benchmark_set():
        for name in FACTORS:
            key = digest(one.positions, limit_set(name))
            assert key in stored, f'{one.name}, {name}'
            assert stored[key].sound(), f'{one.name}, {name}'


AFTER = 'quintic, behind smooth_goals'
LINE = np.array([[0.0, 0.0, 0.5, 0.0, -1.0, 0.0], [1.0, -0.5, 1.0, 0.5, -0.5, 1.0]])


def test_time_splines_match_a_known_motion() -> None:
    """A quintic from rest to rest has a peak velocity of 15/8 of the mean."""
    use = joint_spline('quintic', LINE, np.array([0.0, 0.5]), LIMITS)
    mean = np.max(np.abs(LINE[1] - LINE[0]) / LIMITS.velocity) / 0.5
    assert use.velocity == pytest.approx(15 / 8 * mean, rel=1e-4)
    use = joint_spline('cubic', LINE, np.array([0.0, 0.5]), LIMITS)
    assert use.velocity == pytest.approx(3 / 2 * mean, rel=1e-4)


def test_quintics_after_smooth_goals_respect_the_limits() -> None:
    line, times = LINE[[0, 1, 0]], np.array([0.0, 0.15, 0.15])
    before, after = (joint_spline(name, line, times, LIMITS) for name in ('quintic', AFTER))
    assert min(before.velocity, before.acceleration, before.jerk) > 1.2
    assert max(after.velocity, after.acceleration, after.jerk) <= 1.001
