# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The metrics of the benchmark, its trajectories and its requirements."""

from itertools import pairwise

import numpy as np
import pytest

from benchmark.limit_sets import FACTORS, limit_set
from benchmark.metrics import Metrics, measure
from benchmark.references import References, digest
from benchmark.strategies import SAMPLE_STEP_S, joint_spline, stop_and_go
from benchmark.trajectories import BenchmarkTrajectory, benchmark_set
from benchmark.waypoints import Record
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


@pytest.mark.slow
def test_stored_references_are_complete_and_valid() -> None:
    stored = References()
    for one in benchmark_set():
        for name in FACTORS:
            key = digest(one.positions, limit_set(name))
            assert key in stored, f'{one.name}, {name}'
            assert stored[key].sound(), f'{one.name}, {name}'


AFTER = 'quintic, behind smooth_goals'
LINE = np.array([[0.0, 0.0, 0.5, 0.0, -1.0, 0.0], [1.0, -0.5, 1.0, 0.5, -0.5, 1.0]])


def test_quintics_after_smooth_goals_respect_the_limits() -> None:
    line, times = LINE[[0, 1, 0]], np.array([0.0, 0.15, 0.15])
    before, after = (joint_spline(name, line, times, LIMITS) for name in ('quintic', AFTER))
    assert min(before.velocity, before.acceleration, before.jerk) > 1.2
    assert max(after.velocity, after.acceleration, after.jerk) <= 1.001
