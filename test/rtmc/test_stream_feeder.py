# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The targets of a stream, which replace each other while the transport's thread takes them."""

import numpy as np
import pytest

from epson_driver.motion.setpoint_tracker import servo_limits
from epson_driver.robots import load_robot_model
from epson_driver.rtmc.stream_feeder import HORIZON_S, StreamFeeder

LIMITS = servo_limits(load_robot_model('c8_c901s').limits, 0.25, 0.3)
CYCLE = 0.002
REST = np.zeros(6)
SPEED = np.array([0.5, -0.2, 0.1, 0.0, 0.0, 0.3])


class Ring:
    """A ring whose targets are taken by `take`, and also `meanwhile` before a replacement."""

    def __init__(self):
        self.targets = np.zeros((0, 6))
        self.taken = 0
        self.meanwhile = 0
        self.refused = 0

    def take(self, count=1):
        self.taken = min(self.taken + count, len(self.targets))

    def replace(self, first, targets, planned):
        assert first <= len(self.targets)
        self.take(self.meanwhile)
        if first < self.taken:
            self.refused += 1
            return False
        self.targets = np.concatenate([self.targets[:first], targets])
        assert planned == len(targets)
        return True


@pytest.fixture
def wanted():
    return []


@pytest.fixture
def feeder(wanted):
    return StreamFeeder(LIMITS, REST, wanted.append)


def usage(targets):
    steps, result = np.concatenate([np.zeros((3, 6)), targets]), []
    for limit in (LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk):
        steps = np.diff(steps, axis=0) / CYCLE
        result.append(float(np.max(np.abs(steps) / limit)))
    return max(result)


def test_command_before_the_motion_requests_it_only_if_the_arm_would_move(feeder, wanted):
    feeder.move(0.02, REST)
    feeder.brake()
    assert wanted == []
    feeder.move(0.02, SPEED)
    assert wanted == [feeder]
    np.testing.assert_array_equal(feeder.state[0], REST)
    assert feeder.at_rest


@pytest.mark.invariant(2)
@pytest.mark.parametrize('meanwhile', [0, 3, 9])
def test_inv2_targets_join_although_others_are_taken_meanwhile(feeder, meanwhile):
    ring = Ring()
    feeder.begin(REST, CYCLE, ring)
    for index in range(60):
        feeder.move(0.02, SPEED if index % 20 < 12 else -SPEED)
        ring.take(10 if index % 7 else 40)
        feeder.step(0.02)
        ring.meanwhile = meanwhile
    assert (ring.refused > 0) == (meanwhile > 2)
    assert np.ptp(ring.targets, axis=0).max() > 0.05
    assert usage(ring.targets) <= 1.0 + 1e-6


@pytest.mark.invariant(3, 4)
def test_inv3_stream_without_commands_or_with_a_stop_ends_at_rest(feeder):
    ring = Ring()
    feeder.begin(REST, CYCLE, ring)
    for _ in range(20):
        feeder.move(0.02, SPEED)
        ring.take(10)
    feeder.stop('a test')
    count = len(ring.targets)
    feeder.move(0.02, SPEED)
    feeder.stop('later')
    assert len(ring.targets) == count
    assert feeder.failed == 'a test'
    assert not feeder.at_rest
    ring.take(count)
    assert feeder.at_rest
    assert usage(ring.targets) <= 1.0 + 1e-6
    np.testing.assert_allclose(ring.targets[-1], feeder.motion.end)


def test_step_lasts_longer_than_the_time_between_two_commands(feeder):
    ring = Ring()
    feeder.begin(REST, CYCLE, ring)
    feeder.move(0.02, SPEED)
    speeds = np.diff(ring.targets[:, 0])
    assert speeds.argmax() * CYCLE >= HORIZON_S - 2 * CYCLE
