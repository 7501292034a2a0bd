# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Filtering of single setpoints: lag, jerk, noise and ends (the figures of docs/servo.md)."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from support.driver_harness import HOME, LIMITS, pose
from support.examples import one_in, quickly
from support.streams import PERIOD

from epson_driver.driver.servo.stream import PASSED, StreamFilter
from epson_driver.motion.setpoint_tracker import SetpointTracker, servo_limits

SERVO = servo_limits(LIMITS, 0.25, 0.3)
SERVO = replace(SERVO, velocity=0.8 * SERVO.velocity)  # like driver/servo/servo.py
STEPS = (0.004, 0.02)
"""Periods of the tracker, s."""


def sine(t):
    """0.5 Hz, 0.63 rad/s at most."""
    return 0.2 * (1.0 - np.cos(np.pi * t)), 0.2 * np.pi * np.sin(np.pi * t)


def ramp(speed, end):
    return lambda t: (speed * min(t, end), speed * (t < end))


def still(_):
    return 0.0, 0.0


def followed(wave, duration, *, step=0.02, velocities=False, noise=0.0, lost=0.0, phase=0.5):
    """Follow a 50 Hz stream, and return times, positions and jerk ratios of joint 1."""
    random = np.random.default_rng(0)
    stream, tracker = StreamFilter(SERVO), SetpointTracker(SERVO, HOME)
    rows = []
    count = 0
    for now in np.arange(phase * step, duration, step):
        while count * PERIOD <= now:
            position, velocity = wave(count * PERIOD)
            position += noise * random.standard_normal()
            if count == 0 or random.random() >= lost:
                stream.add(count * PERIOD, pose(position), pose(velocity) if velocities else None)
            count += 1
        tracker.follow(step, stream.aim(now))
        jerk = mean_jerk(tracker.motion, step)
        rows.append((now, tracker.step(step)[0][0], jerk))
    return np.array(rows).T


def mean_jerk(motion, step):
    """Return the mean jerk of joint 1 in a step, as a fraction of its limit."""
    times = np.clip(motion.times[0], 0.0, step)
    return float(np.abs(motion.jerks[0]) @ np.diff(times)) / step / SERVO.jerk[0]


def lag_of(times, path, wave):
    """Return the delay, s, with the smallest rms error to the wave, and that error."""
    chosen = times > 2.0

    def error(lag):
        expected = np.array([wave(t - lag)[0] for t in times[chosen]])
        return float(np.sqrt(np.mean((path[chosen] - expected) ** 2)))

    return min((error(lag), lag) for lag in np.arange(-0.05, 0.2, 0.002))[::-1]


@pytest.mark.parametrize(
    ('velocities', 'max_lag', 'noise'),
    quickly(
        [(False, 0.04, 2e-4), (True, 0.01, 0.0)],
        [(False, 0.04, 0.0), (False, 0.04, 2e-4), (True, 0.01, 0.0), (True, 0.01, 2e-4)],
    ),
)
@pytest.mark.parametrize('step', one_in(2, reversed(STEPS)))
def test_sine_is_followed_with_low_lag_and_jerk(step, velocities, max_lag, noise):
    times, path, jerks = followed(
        sine, 6.0, step=step, velocities=velocities, noise=noise, lost=0.02 * (noise > 0.0)
    )
    lag, rms = lag_of(times, path, sine)
    assert lag <= max_lag
    assert rms < 0.0025
    assert jerks[times > 2.0].mean() < 0.2


@pytest.mark.slow
@pytest.mark.parametrize('velocities', one_in(2, [False, True]))
def test_noise_of_a_constant_stream_barely_moves_the_arm(velocities):
    times, path, _ = followed(still, 20.0, velocities=velocities, noise=1e-3)
    assert path[times > 2.0].std() < 2e-4


@pytest.mark.parametrize('velocities', [False, True])
@pytest.mark.parametrize('step', STEPS)
@pytest.mark.parametrize(
    ('speed', 'phase'),
    quickly([(1.0, 0.8)], product([0.5, 1.0], [0.05, 0.3, 0.55, 0.8])),
)
def test_ramp_that_ends_abruptly_is_not_overshot(speed, step, velocities, phase):
    _, path, _ = followed(ramp(speed, 0.8), 2.5, step=step, velocities=velocities, phase=phase)
    assert path.max() <= speed * 0.8 + 0.002
    assert path[-1] == pytest.approx(speed * 0.8, abs=1e-6)


def test_small_motion_is_not_filtered_as_noise():
    """A hand's motion of a millimetre is followed if the stream has no scatter."""

    def small(t):
        position, velocity = sine(t)
        return position / 200.0, velocity / 200.0

    times, path, _ = followed(small, 6.0)
    lag, rms = lag_of(times, path, small)
    assert lag <= 0.04
    assert rms < 2e-5


@pytest.mark.invariant(2)
def test_inv2_silent_stream_stays_at_its_last_setpoint():
    stream = StreamFilter(SERVO)
    for count in range(30):
        stream.add(count * PERIOD, pose(0.01 * count), pose(0.5))
    aim = stream.aim(29 * PERIOD + 0.1)
    assert aim.is_at_rest
    np.testing.assert_allclose(aim.position, pose(0.29))
    np.testing.assert_allclose(aim.high, pose(0.29) + PASSED)


@pytest.mark.invariant(2)
def test_inv2_setpoints_beyond_range_and_velocity_are_clipped():
    stream = StreamFilter(SERVO)
    for count in range(20):
        stream.add(count * PERIOD, np.full(6, 1e6 * count), np.full(6, 1e9))
        aim = stream.aim(count * PERIOD + 0.01)
        for values in (aim.position, aim.velocity, aim.acceleration, aim.low, aim.high):
            assert np.all(np.isfinite(values))
    assert np.all(aim.position <= LIMITS.position_max + 1.0)


@pytest.mark.parametrize('later', [0.0, -0.5])
def test_last_of_simultaneous_setpoints_is_followed(later):
    stream = StreamFilter(SERVO)
    stream.add(1.0, pose(0.3))
    stream.add(1.0 + later, pose(0.1))
    np.testing.assert_allclose(stream.aim(1.01).position, pose(0.1))
