# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEED_SHARE at the motion program and at the smooth arm: whose it is, and how long it holds."""

import struct

import numpy as np
import pytest
from support.program_harness import ProgramHarness, frame, point
from support.streaming_harness import DT, HOME, LIMITS, PERIOD, StreamingHarness, way

SHARE = 65210
REQUEST, TOPIC = 2, 1
SUCCESS, FAILURE = 1, 2


def share(value, comm_type=REQUEST):
    return frame(SHARE, comm_type, 0, struct.pack('<f', value))


class ScaledHarness(ProgramHarness):
    """`scales` are the shares that the arm was told."""

    def __init__(self, able=True, **changes):
        super().__init__(**{'scales_speed': True} | changes)
        self.scales = []

        def scale(value):
            self.scales.append(value)
            return able

        self.arm.scale = scale

    def answers(self):
        """Return (reply code, body) of the replies since the last call."""
        data, found = self.take_sent(), []
        while data:
            length, msg_type, comm_type, code = struct.unpack_from('<4i', data)
            assert (msg_type, comm_type) == (SHARE, 3)
            found.append((code, data[16 : length + 4]))
            data = data[length + 4 :]
        return found


@pytest.mark.parametrize('value', [0.0, 0.25, 1.0])
def test_a_share_is_in_force_and_confirmed(value):
    harness = ScaledHarness()
    harness.send(share(value))
    assert harness.scales == [value]
    assert harness.answers() == [(SUCCESS, struct.pack('<f', value))]


@pytest.mark.parametrize('value', [-0.01, 1.01, float('nan'), float('inf')])
def test_no_other_number_is_a_share(value):
    harness = ScaledHarness()
    harness.send(share(value))
    assert harness.scales == []
    assert harness.answers() == [(FAILURE, b'')]


@pytest.mark.parametrize('body', [b'', b'\0\0', bytes(12)])
def test_a_body_of_another_length_is_refused(body):
    harness = ScaledHarness()
    harness.send(frame(SHARE, REQUEST, 0, body))
    assert harness.scales == []
    assert [code for code, _ in harness.answers()] == [FAILURE]


def test_who_cannot_or_whose_profile_does_not_say_so_refuses_it():
    for harness in (ScaledHarness(able=False), ScaledHarness(scales_speed=False)):
        harness.send(share(0.5))
        assert harness.answers() == [(FAILURE, b'')]
    assert harness.scales == []


def test_a_topic_is_not_obeyed():
    harness = ScaledHarness()
    harness.send(share(0.5, TOPIC))
    assert harness.scales == []
    assert harness.answers() == []


def test_a_trajectory_of_another_client_that_says_nothing_begins_with_all_speeds():
    harness = ScaledHarness()
    harness.send(share(0.5), point(0, (0.1,)))
    harness.rest()
    harness.send(point(0, (0.2,)))
    harness.rest()
    assert harness.scales == [0.5]
    harness.program.greet()
    assert harness.scales == [0.5]
    harness.send(point(0, (0.3,)))
    assert harness.scales == [0.5, 1.0]


def test_a_motion_that_goes_on_without_its_client_keeps_its_share():
    harness = ScaledHarness()
    harness.send(share(0.5), point(0, (1.0,)))
    harness.step(0.1)
    harness.program.detach()
    harness.program.greet()
    harness.send(point(0, (0.3,)))
    assert harness.arm.moving
    assert harness.scales == [0.5]


@pytest.mark.parametrize('value', [0.0, 0.3])
def test_the_arm_keeps_the_share_through_pause_stop_and_settling(value):
    harness = StreamingHarness()
    arm = harness.arm
    harness.send(way(60))
    harness.run(0.3)
    arm.hold()
    for other in (1.0, value):
        arm.scale(other)
        harness.run(0.5)
        assert arm.still  # it is held all the same
    arm.resume()
    arm.stop()
    harness.waiting.clear()
    harness.run(0.5)
    assert not arm.moving
    arm.settle(HOME)
    harness.send(way(60))
    harness.run(2.0)
    if value == 0.0:
        assert arm.moving
        assert np.all(arm.position == HOME)
    else:
        assert harness.rest() > 59 * PERIOD / value * 0.98 - 2.0


def test_points_that_the_arm_has_are_slowed_down_at_once():
    """A second of points is known; at a fifth of the speed they take five times as long."""
    harness = StreamingHarness()
    harness.send(way(120))
    harness.run(1.0)
    begin = len(harness.velocities)
    harness.arm.scale(0.2)
    harness.run(1.0)
    speeds = np.abs(np.array(harness.velocities[begin:]) / LIMITS.velocity).max(axis=1)
    assert speeds[round(0.5 / DT) :].max() < 0.3 * speeds[0]
    harness.arm.scale(0.0)
    harness.run(0.5)
    assert harness.arm.still
    assert harness.arm.moving
    harness.arm.scale(1.0)
    harness.rest()
    np.testing.assert_allclose(harness.positions[-1], way(120)[-1], atol=1e-6)
