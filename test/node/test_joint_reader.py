# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Joint states by name: from one publisher, and fresh."""

import math

import pytest
from builtin_interfaces.msg import Time

from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.node.joint_reader import JointReader

NAMES, LIMITS = ('a', 'b'), (1.0, 2.0)
OLDEST_S = 1.0


class Topic:
    """A topic with a reader. Stamps are off by `ahead` s, and messages are late by `delay` s."""

    def __init__(self):
        self.reader = JointReader('joint_states')

    def send(self, now, names, positions, velocities=(), ahead=0.0, delay=0.0):
        nanoseconds = round((100.0 + now + ahead) * 1e9)
        stamp = Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        return self.reader.take(list(names), list(positions), list(velocities), stamp, now + delay)

    def read(self, now, names=NAMES, limits=LIMITS):
        return [values.tolist() for values in self.reader.of(names, limits, OLDEST_S, now)]


def test_joints_are_found_by_name_and_missing_velocities_estimated():
    topic = Topic()
    assert not topic.reader
    topic.send(0.0, 'ba', (0.2, 0.1), (0.02, 0.01))
    assert topic.read(0.0) == [[0.1, 0.2], [0.01, 0.02]]
    topic.send(0.0, ['finger'], [0.7])  # a gripper's joint
    topic.send(0.1, 'ab', (0.15, 0.2))
    positions, velocities = topic.read(0.2)
    assert (positions, velocities) == ([0.15, 0.2], [pytest.approx(0.5), 0.0])
    assert topic.reader
    with pytest.raises(GoalRejectedError, match='no position of a on joint_states in the last 1'):
        topic.read(1.2)
    with pytest.raises(GoalRejectedError, match='no position of c on'):
        topic.read(0.2, ('a', 'c'))


@pytest.mark.parametrize(
    ('names', 'positions'),
    [('ab', (0.1, math.nan)), ('ab', (0.1, 1e308)), ('ab', (0.1,)), ('aa', (0.1, 0.2))],
)
def test_invalid_message_is_ignored(names, positions):
    topic = Topic()
    assert not topic.send(0.0, names, positions)
    with pytest.raises(GoalRejectedError):
        topic.read(0.0)


@pytest.mark.invariant(10)
@pytest.mark.parametrize('ahead', [0.0, 0.5, -0.5, 1e4, -100.0])
@pytest.mark.parametrize('period', [0.02, 0.9, 5.0])
def test_inv10_two_publishers_are_detected_by_a_joint_jump(ahead, period):
    """With any stamps, the joint is too fast in at least one direction."""
    topic = Topic()
    refused = []
    for step in range(1000):
        now = 0.01 * step
        topic.send(now, 'ab', (0.0, 0.0))
        if step % round(period / 0.01) == 0:
            topic.send(now + 0.005, 'ba', (1.0, 0.0), ahead=ahead)
        else:
            with_stranger = now - period * math.floor(now / period) < 1.0
            try:
                topic.read(now)
            except GoalRejectedError as error:
                refused.append(str(error))
            else:
                assert not with_stranger
    assert 'b jumps on joint_states, at' in refused[0]
    assert 'where its limit is 2 /s: two publishers disagree' in refused[0]


def test_fast_arm_with_late_messages_is_no_second_publisher():
    topic = Topic()
    for step in range(1000):
        now, stall = 0.1 * step, 0.5 * (step % 6 != 0)
        triangle = abs((now + 1.0) % 4.0 - 2.0) - 1.0
        topic.send(now, 'ab', (triangle, 2.0 * triangle), delay=stall * (1.0 - step % 6 / 6.0))
        assert topic.read(now)[0][0] == pytest.approx(triangle)
