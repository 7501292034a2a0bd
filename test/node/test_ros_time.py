# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""RosTimeStamps of past moments are correct and increase (invariants 6 and 8)."""

from types import SimpleNamespace

import pytest

from epson_driver.node.ros_process import RosTimeStamps

pytestmark = pytest.mark.invariant(6, 8)

BEGIN = 1_700_000_000_000_000_000


class Clocks:
    """A monotonic clock, s, and a ROS clock that is `ahead` ns ahead."""

    def __init__(self):
        self.time = 5000.0
        self.ahead = BEGIN
        self.reading_takes = 2e-6

    def monotonic(self):
        return self.time

    def now(self):
        self.time += self.reading_takes
        return SimpleNamespace(nanoseconds=round(self.time * 1e9) + self.ahead)


@pytest.fixture
def clocks():
    return Clocks()


@pytest.fixture
def stamps(clocks):
    return RosTimeStamps(clocks, clocks.monotonic)


def since(clocks, stamp, moment):
    """Return the error of a stamp, s."""
    return (stamp.sec * 10**9 + stamp.nanosec - clocks.ahead - round(moment * 1e9)) * 1e-9


def test_inv6_time_in_the_past_gets_a_stamp_in_the_past(clocks, stamps):
    """docs/invariants.md, 6."""
    assert since(clocks, stamps.stamp(clocks.time - 3.0), clocks.time - 3.0) == pytest.approx(
        0.0, abs=1e-5
    )


def test_stamps_are_right_if_the_clock_readings_are_interrupted(clocks, stamps):
    stamps.stamp(clocks.time)
    for count in range(100):
        clocks.reading_takes = 0.05 if count % 3 else 2e-6
        moment = clocks.time
        assert abs(since(clocks, stamps.stamp(moment), moment)) < 1e-5


def test_stamps_follow_the_drift_of_the_ros_clock(clocks, stamps):
    for _ in range(20000):
        clocks.time += 0.005
        clocks.ahead += 500  # ns: 100 ppm
        moment = clocks.time
        off = since(clocks, stamps.stamp(moment), moment)
    assert abs(off) < 2e-4


@pytest.mark.parametrize('seconds', [3600, -3600])
def test_stamps_follow_a_step_of_the_ros_clock_immediately(clocks, stamps, seconds):
    stamps.stamp(clocks.time)
    clocks.ahead += seconds * 10**9
    clocks.time += 0.005
    assert abs(since(clocks, stamps.stamp(clocks.time), clocks.time)) < 1e-4


@pytest.mark.parametrize('rate', [0.0, 0.1])
def test_late_sample_under_a_slow_or_paused_clock_is_not_stamped_back(clocks, stamps, rate):
    last = -1
    for late in (0.0, 0.3, 0.0, 0.2) * 5:
        clocks.time += 0.4
        clocks.ahead -= round((1.0 - rate) * 0.4e9)
        stamp = stamps.stamp(clocks.time - late)
        assert stamp.sec * 10**9 + stamp.nanosec > last
        last = stamp.sec * 10**9 + stamp.nanosec


@pytest.mark.invariant(8)
def test_successive_stamps_always_increase(clocks, stamps):
    last = -1
    for moment in (10.0, 10.0, 10.0, 9.99, 10.000001, 10.02, 10.02):
        stamp = stamps.stamp(5000.0 + moment)
        assert stamp.sec * 10**9 + stamp.nanosec > last
        last = stamp.sec * 10**9 + stamp.nanosec
