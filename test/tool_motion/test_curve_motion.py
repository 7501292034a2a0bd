# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motion along a curve: path, rest at both ends, and limits at every instant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples

from epson_driver.motion import JointLimits, go
from epson_driver.tool_motion.curve_motion import MIN_SAMPLES, Curve, CurveSpeed, go_along
from epson_driver.tool_motion.speed_profile import PartLimits, fastest

LIMITS = JointLimits(
    ('a', 'b'),
    np.array([-3.0, -2.0]),
    np.array([3.0, 2.0]),
    np.array([2.0, 4.0]),
    np.array([10.0, 30.0]),
    np.array([100.0, 200.0]),
)
FAST = CurveSpeed(100.0, 1000.0, 10_000.0)


def waved(seed, count=20):
    """Return samples of a random smooth curve within the limits."""
    chance = np.random.default_rng(seed)
    shares = np.linspace(0.0, 1.0, count)[:, None]
    waves = sum(
        chance.uniform(-0.5, 0.5, 2) * np.sin(np.pi * number * shares + chance.uniform(0.0, 6.0))
        for number in (1, 2, 3)
    )
    return np.asarray(waves)


def test_curve_is_exact_for_cubics_and_interpolates_samples():
    shares = np.linspace(0.0, 1.0, 8)[:, None]
    samples = np.hstack([shares**3 - 2.0 * shares, 1.0 - shares**2])
    curve = Curve(samples)
    for fraction in (0.0, 0.1, 0.37, 0.5, 0.99, 1.0):
        position, slope, bend = curve.at(fraction)
        assert position == pytest.approx(
            [fraction**3 - 2.0 * fraction, 1.0 - fraction**2], abs=1e-12
        )
        assert slope == pytest.approx([3.0 * fraction**2 - 2.0, -2.0 * fraction], abs=1e-10)
        assert bend == pytest.approx([6.0 * fraction, -2.0], abs=1e-9)
    wave = waved(1)
    through = Curve(wave)
    for number, sample in enumerate(wave):
        assert through.at(number / (len(wave) - 1))[0] == pytest.approx(sample, abs=1e-12)


@pytest.mark.invariant(2)
@settings(max_examples=examples(50), deadline=None)
@given(st.integers(0, 2**32), st.floats(0.0, 1.0))
def test_inv2_motion_and_stop_respect_limits_and_curve(seed, when):
    """No derivative exceeds its limit for any request, and both end at rest."""
    samples = waved(seed)
    motion = go_along(LIMITS, Curve(samples), FAST)
    stopping = when * motion.duration
    stop = motion.stop(stopping)
    assert motion.at(0.0)[0] == pytest.approx(samples[0])
    assert motion.at(motion.duration)[0] == pytest.approx(samples[-1])
    assert 0.0 < motion.braking < motion.duration
    assert stop.duration <= motion.duration - stopping + 1e-6
    assert stop.at(0.0)[0] == pytest.approx(motion.at(stopping)[0], abs=1e-9)
    assert stop.at(stop.duration)[0] == pytest.approx(stop.end, abs=1e-9)
    for item in (motion, stop):
        times = np.linspace(0.0, item.duration, 400)
        states = [item.at(time) for time in times.tolist()]
        velocities = np.array([velocity for _, velocity, _ in states])
        accelerations = np.array([acceleration for *_, acceleration in states])
        assert np.all(np.abs(velocities) <= LIMITS.velocity * (1.0 + 1e-6))
        assert np.all(np.abs(accelerations) <= LIMITS.acceleration * (1.0 + 1e-6))
        assert np.abs(velocities[-1]).max() < 1e-9
        if item.duration > 1e-3:
            jerks = np.diff(accelerations, axis=0) / np.diff(times)[:, None]
            assert np.all(np.abs(jerks) <= LIMITS.jerk * (1.0 + 1e-3))
            moved = np.gradient(np.array([position for position, *_ in states]), times, axis=0)
            assert np.abs(moved - velocities)[1:-1].max() < 0.05


def test_motion_does_not_exceed_the_requested_speed():
    samples = np.linspace([0.0, 0.0], [1.0, 0.5], MIN_SAMPLES)
    motion = go_along(LIMITS, Curve(samples), CurveSpeed(0.2, 2.0, 20.0))
    velocities = [motion.at(time)[1] for time in np.linspace(0.0, motion.duration, 100).tolist()]
    assert np.max(velocities, axis=0) == pytest.approx([0.2, 0.1], rel=1e-6)


@pytest.mark.parametrize(
    'samples', [np.zeros((4, 2)), np.full((6, 2), np.nan), np.zeros(6)], ids=['few', 'nan', 'flat']
)
def test_invalid_samples_are_refused(samples):
    with pytest.raises(ValueError, match='samples'):
        Curve(samples)


@pytest.mark.parametrize('length', [1e-6, 1e-3, 0.05, 0.3, 2.0])
def test_motion_along_a_single_part_is_time_optimal(length):
    motion = fastest([PartLimits(length, 0.5, 2.0, 20.0)])
    one = np.ones(1)
    limits = JointLimits(('way',), -one, 3 * one, 0.5 * one, 2.0 * one, 20.0 * one)
    assert motion.duration == pytest.approx(go(limits, np.zeros(1), length * one).duration)


@pytest.mark.invariant(2)
def test_motion_along_random_parts_is_smooth_within_the_limits():
    random = np.random.default_rng(18)
    for _ in range(200):
        parts = [
            PartLimits(*(10.0 ** random.uniform((-4, -2, -1, 0), (0, 0.5, 1, 2.5))))
            for _ in range(random.integers(1, 8))
        ]
        motion = fastest(parts)
        seams = np.cumsum([0.0, *(part.length for part in parts)])
        assert motion.positions[-1] == pytest.approx(seams[-1])
        assert motion.velocities[-1] == motion.accelerations[-1] == 0.0
        times = np.sort([*np.linspace(0.0, motion.duration, 2000), *motion.times])
        way, speed, acceleration, jerk = motion.sample(times)
        part = np.clip(np.searchsorted(seams, way - 1e-12) - 1, 0, len(parts) - 1)
        slack = 1.0 + 1e-9
        most = np.array([[p.speed, p.acceleration, p.jerk] for p in parts])
        # an instant at a seam belongs to both sides
        most = np.maximum(most[part], most[np.clip(part + 1, 0, len(parts) - 1)])
        inside = np.min(np.abs(way[:, None] - seams), axis=1) > 1e-9
        exact = np.array([[p.speed, p.acceleration, p.jerk] for p in parts])[part]
        bounds = np.where(inside[:, None], exact, most)
        assert np.all(speed <= bounds[:, 0] * slack)
        assert np.all(np.abs(acceleration) <= bounds[:, 1] * slack + 1e-9)
        assert np.all(np.abs(jerk) <= bounds[:, 2] * slack)
        assert np.all(speed >= -1e-9)
        assert np.all(np.diff(way) >= -1e-9)
        ends = np.array([motion.sample(motion.times[1:] - 1e-12)[k] for k in range(3)])
        begins = np.array([motion.positions[1:], motion.velocities[1:], motion.accelerations[1:]])
        assert np.abs(ends - begins).max() < 1e-6
