# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The generated trajectories are what they claim to be, and the same every time."""

import numpy as np
import pytest

from benchmark.limit_sets import FACTORS, MAX_VELOCITY_RAD_S, limit_set, ramp_time
from benchmark.references import ReferenceFile, digest
from benchmark.trajectories import GENERATED, SHARED, BenchmarkTrajectory, benchmark_set

SCARAS = {'scara_pick_and_place'}
NAMES = [*GENERATED, *sorted({path.stem for path in SHARED.glob('*.yaml')} - SCARAS)]

Trajectories = dict[str, BenchmarkTrajectory]


@pytest.fixture(scope='module')
def trajectories() -> Trajectories:
    return {trajectory.name: trajectory for trajectory in benchmark_set()}


def test_the_set_is_the_same_every_time(trajectories: Trajectories) -> None:
    for one, other in zip(benchmark_set(), trajectories.values(), strict=True):
        assert np.array_equal(one.positions, other.positions)


@pytest.mark.parametrize('name', NAMES)
def test_a_trajectory_can_be_streamed(trajectories: Trajectories, name: str) -> None:
    trajectory = trajectories[name]
    limits = limit_set('full')
    assert 9 <= len(trajectory.positions) <= 1000
    assert trajectory.positions.shape[1] == 6
    assert np.all(trajectory.positions > limits.position_min)
    assert np.all(trajectory.positions < limits.position_max)
    if trajectory.durations is not None:
        assert trajectory.durations.shape == (len(trajectory.positions),)
        assert trajectory.durations[0] == 0.0
        assert np.all(trajectory.durations[1:] > 0.0)


def test_all_kinds_are_there(trajectories: Trajectories) -> None:
    assert list(trajectories) == NAMES
    assert len(NAMES) == 17
    assert [name for name, one in trajectories.items() if one.durations is None] == [
        'around_pillar_positions_only'
    ]
    there = trajectories['reversal'].positions
    assert np.array_equal(there, there[::-1])
    assert np.sum(~np.any(np.diff(trajectories['repeated_points'].positions, axis=0), axis=1)) == 5
    assert np.abs(np.diff(trajectories['tiny_steps'].positions, axis=0)).max() < 1.1e-3


def test_only_the_plan_that_is_too_fast_asks_for_more_than_the_velocity_limits(
    trajectories: Trajectories,
) -> None:
    for name, one in trajectories.items():
        if one.durations is not None:
            speeds = np.abs(np.diff(one.positions, axis=0)) / one.durations[1:, None]
            assert (np.max(speeds / MAX_VELOCITY_RAD_S) > 1.001) == (name == 'too_fast'), name


def test_limit_sets() -> None:
    assert ramp_time(limit_set('full')) == pytest.approx(0.1)
    assert ramp_time(limit_set('half')) == pytest.approx(0.2)
    assert limit_set('half').acceleration == pytest.approx(5.0 * MAX_VELOCITY_RAD_S)


def test_the_stored_references_are_those_of_the_set_and_sound(
    trajectories: Trajectories,
) -> None:
    stored = ReferenceFile()
    for trajectory in trajectories.values():
        for name in FACTORS:
            key = digest(trajectory.positions, limit_set(name))
            assert key in stored, f'{trajectory.name}, {name}: run `make bench-motion`'
            assert stored[key].sound(), f'{trajectory.name}, {name}'
