# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Setpoints of a stream are followed within the limits, and end at rest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.examples import examples
from support.streaming_harness import (
    DT,
    HOME,
    LIMITS,
    PERIOD,
    StreamingHarness,
    assert_within_limits,
)

from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.arm.setpoint_follower import PASSED, ROUNDING

DIRECTION = np.array([1.0, -0.5, 0.4, 0.8, -0.5, 1.2])


def sine(time):
    """0.5 Hz, 0.63 rad/s at most."""
    return 0.2 * (1.0 - np.cos(np.pi * time)) * DIRECTION


class Stream:
    """An arm and the setpoints that it gets every `period` s."""

    def __init__(self, setpoint_at, period=PERIOD):
        self.harness = StreamingHarness()
        self.arm = self.harness.arm
        self._setpoint_at = setpoint_at
        self._period = period
        self._count = 0

    def run(self, setpoints):
        for _ in range(setpoints):
            self.target = self._setpoint_at(self._count * self._period)
            duration = self._period if self._count else 1e-3
            if self.arm.has_room:
                point = Point(self._count, self.target, 0.1, duration, setpoint=not self._count)
                self.arm.take(point)
            self._count += 1
            self.harness.run(self._period)


@pytest.mark.slow
def test_mean_jerk_behind_a_sine_is_hardly_more_than_its_own():
    stream = Stream(sine)
    stream.run(200)
    trace = stream.harness.trace[2000:, 0]
    jerk = np.abs(np.diff(trace, 4)).sum() / len(trace) / DT**3 / LIMITS.jerk[0]
    own = 0.2 * np.pi**3 * 2.0 / np.pi / LIMITS.jerk[0]
    assert 0.5 * own < np.abs(np.diff(trace, 3)).mean() / DT**3 / LIMITS.jerk[0] < 1.5 * own
    assert jerk < 0.02
    assert not stream.harness.planner.limits
    assert_within_limits(stream.harness)


@pytest.mark.invariant(3)
@pytest.mark.parametrize('setpoints', [1, 2, 3, 20, 50])
def test_inv3_stream_that_ends_leaves_the_arm_at_its_last_setpoint(setpoints):
    stream = Stream(sine)
    stream.run(setpoints)
    stream.harness.rest(1.0)
    assert stream.arm.position == pytest.approx(stream.target, abs=ROUNDING)
    beyond = np.abs(stream.harness.trace) - np.abs(stream.target)
    assert beyond.max() <= PASSED
    assert_within_limits(stream.harness)


@pytest.mark.invariant(3)
def test_inv3_stop_ends_a_stream_at_rest_and_loses_its_points():
    stream = Stream(sine)
    stream.run(30)
    assert stream.arm.stop()
    assert not stream.arm.has_room
    stream.harness.rest(0.2)
    assert not stream.arm.velocity.any()
    assert_within_limits(stream.harness)
    stream.harness.send([stream.arm.position, HOME])
    stream.harness.rest()
    assert stream.arm.position.tolist() == HOME.tolist()
    assert stream.harness.planner.limits, 'the trajectory is planned'


def test_held_stream_continues_to_its_last_setpoint_without_turning_back():
    stream = Stream(sine)
    stream.run(30)
    stream.arm.hold()
    stream.harness.until_still()
    rest = len(stream.harness.positions)
    assert stream.arm.moving
    stream.arm.resume()
    stream.harness.rest()
    assert stream.arm.position == pytest.approx(stream.target, abs=ROUNDING)
    assert np.all(np.diff(stream.harness.trace[rest:, 0]) >= -PASSED)
    assert_within_limits(stream.harness)


@pytest.mark.invariant(2)
@settings(max_examples=examples(20))
@given(
    steps=st.lists(st.floats(-0.4, 0.4), min_size=2, max_size=12),
    period=st.sampled_from([0.002, 0.01, 0.02, 0.1]),
)
def test_inv2_any_setpoints_are_followed_within_the_limits(steps, period):
    path = np.clip(np.cumsum([0.0, *steps]), -1.0, 1.0)

    def setpoint_at(time):
        return path[min(round(time / period), len(path) - 1)] * DIRECTION

    stream = Stream(setpoint_at, period)
    stream.run(len(path))
    stream.harness.rest()
    assert stream.arm.position == pytest.approx(stream.target, abs=ROUNDING)
    assert_within_limits(stream.harness)
