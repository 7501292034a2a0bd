# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Noisy recordings: a motion within a tolerance of every point, in the recording's time."""

import numpy as np
import pytest
from support.examples import one_in

from epson_driver.motion import JointLimits, Trajectory, smooth
from epson_driver.motion.closest_samples import passed
from epson_driver.motion.smoothed import MIN_TOLERANCE, denoised
from epson_driver.report.smooth_study import measure
from epson_driver.robots import load_robot_model

ARM = load_robot_model('c3_a601s').limits
JOINTS = len(ARM.names)


def recording(
    seed: int, *, rate: float = 125.0, noise: float = 2e-4, seconds: float = 2.0
) -> Trajectory:
    """Return a hand-guided motion up to 1 Hz in joint space with white noise, rad."""
    rng = np.random.default_rng([seed, 33])
    times = np.arange(round(seconds * rate) + 1) / rate
    waves = 6
    frequency, phase = rng.uniform(0.1, 1.0, (waves, JOINTS)), rng.uniform(0, 7, (waves, JOINTS))
    phases = 2.0 * np.pi * times[:, None, None] * frequency + phase
    amplitude = rng.normal(size=(waves, JOINTS)) * 0.5 / waves
    paths = (amplitude * np.sin(phases)).sum(axis=1)
    paths *= np.sin(np.pi * times / times[-1])[:, None] ** 2
    return Trajectory(ARM.names, times, paths + rng.normal(size=paths.shape) * noise)


def max_distance(recorded: Trajectory, motion: Trajectory) -> float:
    """Return the maximum distance of the motion from a recorded point, rad."""
    return float(passed(recorded.positions, motion)[0].max())


@pytest.mark.parametrize('seed', one_in(6, range(12)))
@pytest.mark.parametrize(
    ('rate', 'noise', 'tolerance'),
    one_in(
        2,
        [(125.0, 2e-4, 1e-3), (125.0, 1e-3, 5e-3), (50.0, 2e-4, 1e-3), (30.0, 5e-4, 5e-3)],
        several=True,
    ),
)
def test_noisy_recording_keeps_its_time_within_the_tolerance(
    seed: int, rate: float, noise: float, tolerance: float
) -> None:
    recorded = recording(seed, rate=rate, noise=noise)
    motion = smooth(recorded.positions, ARM, recorded.times, path_tolerance=tolerance)
    figures = measure(motion, None, ARM)
    assert max_distance(recorded, motion) <= tolerance
    assert motion.duration <= 1.03 * recorded.duration
    assert max(figures.velocity, figures.acceleration) <= 1.0
    assert figures.jerk <= 1.02
    assert figures.stops == 0
    np.testing.assert_array_equal(motion.positions[0], recorded.positions[0])
    np.testing.assert_allclose(motion.positions[-1], recorded.positions[-1], atol=1e-9)


def test_motion_without_tolerance_follows_the_noise() -> None:
    recorded = recording(0)
    assert smooth(recorded.positions, ARM, recorded.times).duration > 1.5 * recorded.duration


def hostile(kind: str, rng: np.random.Generator) -> Trajectory:
    """Return points with difficult times, steps or limits."""
    count = 200
    gaps = {
        'irregular': rng.uniform(1e-3, 0.1, count),
        'doubled': np.where(np.arange(count) % 2, 1e-9, 0.05),
        'pauses': np.where(rng.random(count) < 0.05, 2.0, 0.01),
    }.get(kind, np.full(count, 0.02))
    paths = rng.normal(size=(count, JOINTS)).cumsum(axis=0) * 5e-3
    if kind == 'jumps':
        paths += (rng.random((count, 1)) < 0.1).cumsum(axis=0) * 0.05
    if kind == 'at_limits':
        paths = np.tile(ARM.position_max, (count, 1)) - np.abs(rng.normal(size=paths.shape)) * 1e-3
    if kind == 'huge':
        paths = rng.choice([-1.0, 1.0], paths.shape) * 2.0
    low, high = ARM.position_min, ARM.position_max
    return Trajectory(ARM.names, np.cumsum(gaps), np.clip(paths, low, high))


@pytest.mark.parametrize('tolerance', [1e-3, 5e-3, 0.2])
@pytest.mark.parametrize('kind', ['irregular', 'doubled', 'pauses', 'jumps', 'at_limits', 'huge'])
@pytest.mark.parametrize('seed', one_in(5, range(5)))
def test_denoising_moves_points_by_less_than_the_tolerance(
    kind: str, tolerance: float, seed: int
) -> None:
    recorded = hostile(kind, np.random.default_rng([seed, 7]))
    result = denoised(recorded, ARM, tolerance)
    moved = np.abs(result.positions - recorded.positions)
    assert moved.max() <= tolerance - MIN_TOLERANCE / 2.0 + 1e-12
    assert moved[[0, -1]].max() == 0.0
    assert np.all((result.positions >= ARM.position_min) & (result.positions <= ARM.position_max))
    np.testing.assert_array_equal(result.times, recorded.times)
    if kind != 'doubled':  # whose second differences come mostly from two points
        bend = [np.diff(plan.positions, 2, axis=0) for plan in (recorded, result)]
        assert np.abs(bend[1]).sum() < np.abs(bend[0]).sum()


def test_denoising_does_not_move_points_of_a_commanded_rest() -> None:
    recorded = recording(1)
    still = recorded.positions.copy()
    times = recorded.times.copy()
    still[101:103] = still[100]
    times[101:] += 0.3
    times[102:] += 0.4
    result = denoised(Trajectory(ARM.names, times, still), ARM, 5e-3)
    np.testing.assert_array_equal(result.positions[100:103], still[100:103])
    assert np.abs(result.positions[90] - still[90]).max() > 0.0
    motion = smooth(still, ARM, times, path_tolerance=5e-3)
    here = np.abs(motion.positions - still[100]).max(axis=1) < 1e-6
    assert here.sum() * 0.004 > 0.6


def test_result_has_the_joint_order_of_the_limits() -> None:
    recorded = recording(2)
    names = recorded.joint_names[::-1]
    swapped = Trajectory(names, recorded.times, recorded.positions[:, ::-1])
    ours, theirs = denoised(recorded, ARM, 2e-3), denoised(swapped, ARM, 2e-3)
    assert theirs.joint_names == ARM.names
    np.testing.assert_array_equal(theirs.positions, ours.positions)


@pytest.mark.parametrize('count', [1, 2])
def test_denoising_does_not_change_two_points(count: int) -> None:
    recorded = recording(3)
    ends = Trajectory(ARM.names, recorded.times[:count], recorded.positions[:count])
    np.testing.assert_array_equal(denoised(ends, ARM, 1e-3).positions, ends.positions)


@pytest.mark.parametrize('value', [-0.001, 1e-4, 0.51, float('nan'), float('inf')])
def test_invalid_tolerance_is_rejected(value: float) -> None:
    recorded = recording(4)
    with pytest.raises(ValueError, match=r'0 or at least 0.001 if the points have times'):
        smooth(recorded.positions, ARM, recorded.times, path_tolerance=value)
    if not value >= MIN_TOLERANCE:
        with pytest.raises(ValueError, match=r'the tolerance .* rad must be 0.001 or more'):
            denoised(recorded, ARM, value)


def test_prismatic_joint_is_smoothed_in_metres() -> None:
    """The tolerance and the noise of a prismatic joint are in m."""
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
