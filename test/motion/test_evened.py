# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings with noise: near every point within a tolerance, in the recording's time."""

from typing import Any

import numpy as np
import pytest
from support.examples import one_in

from epson_driver.motion import JointLimits, Trajectory, smooth
from epson_driver.motion.passages import measure, passed
from epson_driver.motion.smoothed import MIN_TOLERANCE, evened
from epson_driver.robots import load_robot_model

ARM = load_robot_model('c3_a601s').limits
JOINTS = len(ARM.names)


def recording(
    seed: int, *, rate: float = 125.0, noise: float = 2e-4, seconds: float = 2.0
) -> Trajectory:
    """Return what a hand shows in joint space, up to 1 Hz, with white noise, rad."""
    rng = np.random.default_rng([seed, 33])
    times = np.arange(round(seconds * rate) + 1) / rate
    waves = 6
    frequency, phase = rng.uniform(0.1, 1.0, (waves, JOINTS)), rng.uniform(0, 7, (waves, JOINTS))
    phases = 2.0 * np.pi * times[:, None, None] * frequency + phase
    amplitude = rng.normal(size=(waves, JOINTS)) * 0.5 / waves
    ways = (amplitude * np.sin(phases)).sum(axis=1)
    ways *= np.sin(np.pi * times / times[-1])[:, None] ** 2
    return Trajectory(ARM.names, times, ways + rng.normal(size=ways.shape) * noise)


def off(given: Trajectory, motion: Trajectory) -> float:
    """Return how far from a given point the motion passes at most, rad."""
    return float(passed(given.positions, motion)[0].max())


@pytest.mark.parametrize('seed', one_in(6, range(12)))
@pytest.mark.parametrize(
    ('rate', 'noise', 'tolerance'),
    one_in(
        2,
        [(125.0, 2e-4, 1e-3), (125.0, 1e-3, 5e-3), (50.0, 2e-4, 1e-3), (30.0, 5e-4, 5e-3)],
        several=True,
    ),
)
def test_a_noisy_recording_takes_its_time_within_the_tolerance_of_every_point(
    seed: int, rate: float, noise: float, tolerance: float
) -> None:
    given = recording(seed, rate=rate, noise=noise)
    motion = smooth(given.positions, ARM, given.times, path_tolerance=tolerance)
    figures = measure(motion, None, ARM)
    assert off(given, motion) <= tolerance
    assert motion.duration <= 1.03 * given.duration
    assert max(figures.velocity, figures.acceleration) <= 1.0
    assert figures.jerk <= 1.02
    assert figures.stops == 0
    np.testing.assert_array_equal(motion.positions[0], given.positions[0])
    np.testing.assert_allclose(motion.positions[-1], given.positions[-1], atol=1e-9)


def test_without_a_tolerance_it_goes_through_the_noise() -> None:
    given = recording(0)
    assert smooth(given.positions, ARM, given.times).duration > 1.5 * given.duration


def hostile(kind: str, rng: np.random.Generator) -> Trajectory:
    """Return points that are hard to move: by their times, their ways, or the limits there."""
    count = 200
    gaps = {
        'irregular': rng.uniform(1e-3, 0.1, count),
        'doubled': np.where(np.arange(count) % 2, 1e-9, 0.05),
        'pauses': np.where(rng.random(count) < 0.05, 2.0, 0.01),
    }.get(kind, np.full(count, 0.02))
    ways = rng.normal(size=(count, JOINTS)).cumsum(axis=0) * 5e-3
    if kind == 'jumps':
        ways += (rng.random((count, 1)) < 0.1).cumsum(axis=0) * 0.05
    if kind == 'at_limits':
        ways = np.tile(ARM.position_max, (count, 1)) - np.abs(rng.normal(size=ways.shape)) * 1e-3
    if kind == 'huge':
        ways = rng.choice([-1.0, 1.0], ways.shape) * 2.0
    low, high = ARM.position_min, ARM.position_max
    return Trajectory(ARM.names, np.cumsum(gaps), np.clip(ways, low, high))


@pytest.mark.parametrize('tolerance', [1e-3, 5e-3, 0.2])
@pytest.mark.parametrize('kind', ['irregular', 'doubled', 'pauses', 'jumps', 'at_limits', 'huge'])
@pytest.mark.parametrize('seed', one_in(5, range(5)))
def test_points_move_by_no_more_than_the_smoother_leaves_of_the_tolerance(
    kind: str, tolerance: float, seed: int
) -> None:
    given = hostile(kind, np.random.default_rng([seed, 7]))
    found = evened(given, ARM, tolerance)
    moved = np.abs(found.positions - given.positions)
    assert moved.max() <= tolerance - MIN_TOLERANCE / 2.0 + 1e-12
    assert moved[[0, -1]].max() == 0.0
    assert np.all((found.positions >= ARM.position_min) & (found.positions <= ARM.position_max))
    np.testing.assert_array_equal(found.times, given.times)
    if kind != 'doubled':  # where a second difference is mostly that of two points
        bend = [np.diff(each.positions, 2, axis=0) for each in (given, found)]
        assert np.abs(bend[1]).sum() < np.abs(bend[0]).sum()


def test_points_that_command_a_rest_stay() -> None:
    given = recording(1)
    still = given.positions.copy()
    times = given.times.copy()
    still[101:103] = still[100]
    times[101:] += 0.3
    times[102:] += 0.4
    found = evened(Trajectory(ARM.names, times, still), ARM, 5e-3)
    np.testing.assert_array_equal(found.positions[100:103], still[100:103])
    assert np.abs(found.positions[90] - still[90]).max() > 0.0
    motion = smooth(still, ARM, times, path_tolerance=5e-3)
    here = np.abs(motion.positions - still[100]).max(axis=1) < 1e-6
    assert here.sum() * 0.004 > 0.6


def test_joints_come_in_the_order_of_the_limits() -> None:
    given = recording(2)
    names = given.joint_names[::-1]
    swapped = Trajectory(names, given.times, given.positions[:, ::-1])
    ours, theirs = evened(given, ARM, 2e-3), evened(swapped, ARM, 2e-3)
    assert theirs.joint_names == ARM.names
    np.testing.assert_array_equal(theirs.positions, ours.positions)


@pytest.mark.parametrize('count', [1, 2])
def test_there_is_nothing_to_move_of_two_points(count: int) -> None:
    given = recording(3)
    ends = Trajectory(ARM.names, given.times[:count], given.positions[:count])
    np.testing.assert_array_equal(evened(ends, ARM, 1e-3).positions, ends.positions)


@pytest.mark.parametrize('value', [-0.001, 1e-4, 0.51, float('nan'), float('inf')])
def test_a_tolerance_that_is_wrong_is_refused(value: float) -> None:
    given = recording(4)
    with pytest.raises(ValueError, match=r'path_tolerance = .* with times 0 or from 0.001 on'):
        smooth(given.positions, ARM, given.times, path_tolerance=value)
    if not value >= MIN_TOLERANCE:
        with pytest.raises(ValueError, match=r'the tolerance .* rad must be 0.001 or more'):
            evened(given, ARM, value)


def test_it_is_for_whole_plans() -> None:
    given = recording(5)
    settings: dict[str, Any] = {'path_tolerance': 2e-3, 'look_ahead': 0.5}
    with pytest.raises(ValueError, match='0 with a look-ahead'):
        smooth(given.positions, ARM, given.times, **settings)


def test_a_slow_arm_has_units_of_its_own() -> None:
    """A prismatic joint counts in m, and its noise is as small."""
    limits = JointLimits(
        ('lift', 'turn'),
        np.array([0.0, -3.0]),
        np.array([1.0, 3.0]),
        np.array([0.5, 2.0]),
        np.array([4.0, 20.0]),
        np.array([40.0, 200.0]),
    )
    rng = np.random.default_rng(6)
    times = np.arange(251) / 125.0
    wave = 0.5 - 0.5 * np.cos(np.pi * times / 2.0)
    clean = np.column_stack([0.1 + 0.3 * wave, wave])
    noisy = clean + rng.normal(size=clean.shape) * 2e-4
    motion = smooth(noisy, limits, times, path_tolerance=1.5e-3)
    assert passed(noisy, motion)[0].max() <= 1.5e-3
    assert motion.duration <= 1.1 * times[-1]
