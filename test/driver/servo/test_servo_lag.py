# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Lag of the arm behind a stream: the figures of docs/servo.md, in virtual time.

The streams have 50 Hz, 4 ms of jitter and 2 % loss. ROS, networks and planning are not included.
`pytest -rP -m '' -k held_key test/driver/servo/test_servo_lag.py` prints the figures of jogs.
"""

import asyncio

import numpy as np
import pytest
from support.driver_harness import pose
from support.event_loop import now
from support.policy_lag import SETTLED_S, behind
from support.streams import PERIOD, jogging, positions, velocities, window

from epson_driver.driver.servo.stream import StreamLag
from epson_driver.driver.state.robot_state import JointSample

DURATION = 7.0
JITTER = 0.004
LOST = 0.02
WINDOW = 0.1


def sine(t):
    """0.5 Hz, 0.63 rad/s at most."""
    return 0.2 * (1.0 - np.cos(np.pi * t)), 0.2 * np.pi * np.sin(np.pi * t)


def triangle(t):
    """Back and forth at 0.5 rad/s."""
    phase = t % 4.0
    return (0.5 * phase, 0.5) if phase < 2.0 else (0.5 * (4.0 - phase), -0.5)


def only_positions(wave, t):
    return positions(pose(wave(t)[0]))


def with_velocities(wave, t):
    position, velocity = wave(t)
    return positions(pose(position), pose(velocity))


def windows(wave, t):
    """Return the setpoint that the node makes of a window ending 0.1 s ahead."""

    def state(ahead):
        position, velocity = wave(t + ahead)
        return pose(position), pose(velocity)

    return window(state, WINDOW)


async def followed(harness, stream, wave, duration=DURATION):
    """Send a stream, and return the measured times, s, and positions of joint 1."""
    random = np.random.default_rng(0)
    start = now()
    first = len(harness.events.samples)
    count = 0
    while (t := now() - start) < duration:
        if random.random() >= LOST:
            harness.driver.servo.take(stream(wave, t))
        count += 1
        due = start + count * PERIOD + random.uniform(-JITTER, JITTER)
        await asyncio.sleep(max(due - now(), 0.0))
    samples = [sample for _, sample in harness.events.samples[first:]]
    times = np.array([sample.measured for sample in samples]) - start
    return times, np.array([sample.positions[0] for sample in samples])


STREAMS = {
    'positions': only_positions,
    'positions with velocities': with_velocities,
    'windows': windows,
}
BARS = {  # s, for sine and triangle: positions, with velocities, windows
    ('simulated', True): ((0.2, 0.22), (0.17, 0.2), (0.1, 0.1)),
    ('simulated', False): ((0.35, 0.38), (0.31, 0.39), (0.21, 0.27)),
    ('generic', False): ((0.35, 0.37), (0.32, 0.36), (0.23, 0.26)),
    ('fanuc', False): ((0.34, 0.36), (0.3, 0.34), (0.21, 0.24)),
    ('spel', False): ((0.27, 0.5), (0.24, 0.51), (0.12, 0.42)),
    ('rtmc', False): ((0.03, 0.14), (0.02, 0.13), (0.02, 0.03)),
}
"""By profile and whether the arm moves smoothly, with a margin over the measured lag."""

WAVES = (sine, triangle)

USUAL = (('simulated', True), ('spel', False))
"""The controllers of `BARS` that most users have. `make soak-tests` tries the others as well."""


@pytest.mark.slow
@pytest.mark.parametrize(
    'wave', [sine, pytest.param(triangle, marks=pytest.mark.soak)], ids=['sine', 'triangle']
)
@pytest.mark.parametrize('stream', STREAMS)
@pytest.mark.parametrize(
    'controller',
    [pytest.param(row, marks=() if row in USUAL else pytest.mark.soak) for row in BARS],
    ids=lambda row: f'{row[0]} {"smooth" * row[1]}',
)
async def test_lag_behind_a_stream_is_as_documented(controller, stream, wave, record_property):
    async with jogging(*controller) as harness:
        times, path = await followed(harness, STREAMS[stream], wave)
        lag, rms = behind(times, path, lambda at: np.array([wave(t)[0] for t in at]))
        record_property('figures', f'lag {lag * 1e3:.0f} ms, rms {rms * 1e3:.1f} mrad')
        bar = BARS[controller][list(STREAMS).index(stream)][WAVES.index(wave)]
        assert lag <= bar + 1e-9
        assert harness.gate is None


HELD_S = 1.0
JOG_SPEED = 0.4
JOG_BARS = {
    ('simulated', True): 0.18,
    ('simulated', False): 0.38,
    ('generic', False): 0.33,
    ('fanuc', False): 0.31,
    ('spel', False): 0.28,
}
"""Maximum lag, s, with a margin over the measured lag."""


@pytest.mark.slow
@pytest.mark.parametrize('controller', JOG_BARS, ids=lambda row: f'{row[0]} {"smooth" * row[1]}')
async def test_lag_behind_a_held_key_is_as_documented(controller):
    async with jogging(*controller) as harness:
        key = velocities(pose(JOG_SPEED))
        times, path = await followed(harness, lambda _wave, _t: key, None, HELD_S)
        later = times + SETTLED_S  # `behind` ignores the time before

        def wave(at):
            return JOG_SPEED * np.clip(at - SETTLED_S, 0.0, HELD_S)

        lag, rms = behind(later, path - path[0], wave)
        print(f'lag {lag * 1e3:.0f} ms, rms {rms * 1e3:.0f} mrad')
        assert lag <= JOG_BARS[controller]
        assert harness.gate is None


PERIOD_S = 0.01
SPEED = 0.5
"""rad/s"""


def measure(lag, time, position):
    lag.update(JointSample(time, np.array([position]), np.zeros(1), time))


def test_constant_lag_is_measured():
    lag = StreamLag()
    for time in np.arange(0.0, 3.0, PERIOD_S):
        lag.sent(time, np.array([SPEED * time]))
        measure(lag, time, SPEED * max(time - 0.3, 0.0))
    assert lag.behind == pytest.approx(0.3, abs=0.02)
    assert lag.now == pytest.approx(0.3, abs=0.02)


def test_lag_stays_and_distance_shrinks_after_the_last_point():
    lag, behind, end = StreamLag(), 0.6, 1.0
    ahead = []
    for time in np.arange(0.0, end + behind + 2.0 * PERIOD_S, PERIOD_S):
        if time <= end:
            lag.sent(time, np.array([SPEED * time]))
        measure(lag, time, SPEED * max(time - behind, 0.0))
        ahead.append(lag.ahead)
        if behind < time < end + behind - PERIOD_S:
            assert lag.now == pytest.approx(behind, abs=0.02)
    assert ahead[round(end / PERIOD_S)] == pytest.approx(behind, abs=0.02)
    assert ahead[round((end + 0.3) / PERIOD_S)] == pytest.approx(behind - 0.3, abs=0.02)
    assert lag.ahead == 0.0
