# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""JOINT_SETPOINT on the motion port: which are followed, and what each refusal is."""

import math
import struct

import numpy as np
import pytest
from support.program_harness import (
    FAILURE,
    HOME,
    LIMITS,
    SUCCESS,
    THERE,
    TOPIC,
    ProgramHarness,
    frame,
    point,
)

from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.arm.following import Following
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.condition.errors import corrupt
from epson_driver.sim_controller.condition.states import Event
from epson_driver.simple_message import Framer

NEAR = (0.05, 0.0, 0.0, 0.0, 0.0, 0.0)
FAR = (0.2, 0.0, 0.0, 0.0, 0.0, 0.0)


def setpoint(sequence, joints=HOME, velocities=HOME, scale=1.0, comm_type=2):
    fill = [0.0] * 4
    numbers = [*joints, *fill, *velocities, *fill, scale]
    return frame(1510, comm_type, 0, struct.pack('<i21f', sequence, *numbers))


class Harness(ProgramHarness):
    """A motion program whose arm follows setpoints."""

    def make_arm(self, arm):
        return Following(arm, LIMITS)

    def answers(self):
        """Return the reply codes to setpoints since the last call; other replies are wrong."""
        data, codes = self.take_sent(), []
        while data:
            length, msg_type, comm_type, code = struct.unpack_from('<4i', data)
            assert (length, msg_type, comm_type) == (12, 1510, 3)
            codes.append(code)
            data = data[length + 4 :]
        return codes


@pytest.fixture
def harness():
    return Harness('setpoints')


def follow(harness, count, step=0.01, start=0):
    for sequence in range(start, start + count):
        harness.send(setpoint(sequence, (step * sequence, 0.0, 0.0, 0.0, 0.0, 0.0)))
        harness.step(0.02)


def test_setpoints_are_answered_at_once_and_the_newest_counts(harness):
    follow(harness, 30)
    assert harness.answers() == [SUCCESS] * 30
    assert harness.events == ['began']
    harness.rest()
    assert harness.joints[0] == pytest.approx(0.29, abs=1e-6)
    assert harness.error == 0


@pytest.mark.parametrize('name', ['rc620', 'generic'])
def test_a_controller_that_does_not_know_them_refuses_and_stays_as_it_is(name):
    """REP-I0006: an unknown request gets FAILURE with its own type, and nothing else happens."""
    harness = ProgramHarness(name)
    harness.send(point(0, THERE))
    harness.send(setpoint(0))
    assert harness.take_sent()[-16:] == struct.pack('<4i', 12, 1510, 3, FAILURE)
    assert harness.error == 0
    harness.rest()
    np.testing.assert_allclose(harness.joints, np.float32(THERE))


@pytest.mark.invariant(1)
@pytest.mark.parametrize(
    'bad',
    [
        setpoint(3, NEAR),
        setpoint(0, FAR),
        setpoint(0, (4.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        setpoint(0, (math.nan, 0.0, 0.0, 0.0, 0.0, 0.0)),
        setpoint(0, NEAR, (math.inf, 0.0, 0.0, 0.0, 0.0, 0.0)),
        setpoint(-1, NEAR),
        setpoint(0, NEAR, scale=0.0),
        setpoint(0, NEAR, scale=1.5),
        setpoint(0, NEAR, scale=math.nan),
    ],
    ids=['sequence', 'far', 'outside', 'nan', 'inf', 'negative', 'no scale', 'scale', 'nan scale'],
)
def test_inv1_a_bad_setpoint_moves_nothing_and_says_why(harness, bad, caplog):
    harness.send(bad)
    assert harness.answers() == [FAILURE]
    assert harness.error != 0
    assert 'JOINT_SETPOINT' in caplog.text
    harness.step(1.0)
    assert not np.any(harness.joints)


@pytest.mark.invariant(3)
@pytest.mark.parametrize(
    'bad',
    [setpoint(99, NEAR), setpoint(20, (9.0, 0.0, 0.0, 0.0, 0.0, 0.0)), point(7, THERE)],
    ids=['sequence', 'outside', 'a point out of sequence'],
)
def test_inv3_what_is_refused_in_a_stream_ends_it(harness, bad):
    follow(harness, 20)
    harness.take_sent()
    harness.send(bad)
    harness.take_sent()
    harness.rest()
    rests = harness.joints
    harness.send(setpoint(20, (rests[0] + 0.05, *rests[1:])))
    assert harness.answers() == [FAILURE]
    assert harness.joints == rests


@pytest.mark.invariant(3)
def test_inv3_stop_ends_a_stream_and_only_a_new_one_goes_on(harness):
    follow(harness, 20)
    harness.answers()
    harness.send(point(-4))
    assert harness.codes() == [(-4, SUCCESS)]
    harness.send(setpoint(20, NEAR))
    assert harness.answers() == [FAILURE]
    harness.rest()
    there = harness.joints
    harness.send(setpoint(0, (there[0] + 0.05, *there[1:])))
    assert harness.answers() == [SUCCESS]
    harness.rest()
    assert harness.joints[0] == pytest.approx(there[0] + 0.05, abs=1e-6)


def test_a_stream_that_rested_goes_on_with_its_next_number_near_the_arm(harness):
    follow(harness, 10)
    harness.rest()
    harness.step(2.0)
    harness.answers()
    harness.send(setpoint(10, (0.15, 0.0, 0.0, 0.0, 0.0, 0.0)))
    assert harness.answers() == [SUCCESS]
    harness.rest()
    harness.send(setpoint(11, (0.35, 0.0, 0.0, 0.0, 0.0, 0.0)))
    assert harness.answers() == [FAILURE]


@pytest.mark.invariant(4)
@pytest.mark.parametrize('way', ['abort', 'restart', 'detach', 'pause'])
def test_inv4_after_whatever_ends_motion_a_stream_begins_with_0(harness, way):
    follow(harness, 10)
    harness.answers()
    getattr(harness.program, way)()
    harness.program.resume()
    harness.arm.stop()
    harness.rest()
    harness.send(setpoint(10, tuple(harness.joints)))
    assert harness.answers() == [FAILURE]


def test_setpoints_and_points_exclude_each_other(harness):
    harness.send(point(0, THERE))
    harness.step(0.1)
    harness.send(setpoint(0))
    data = harness.take_sent()
    assert data[-16:] == struct.pack('<4i', 12, 1510, 3, FAILURE)
    harness.rest()
    harness.send(setpoint(0, tuple(harness.joints)))
    assert harness.answers() == [SUCCESS]


def test_a_blocked_controller_follows_nothing(harness):
    harness.blocked = corrupt('for the test')
    harness.send(setpoint(0, NEAR))
    assert harness.answers() == [FAILURE]
    harness.step(0.5)
    assert not np.any(harness.joints)


def test_a_topic_is_not_followed_and_not_answered(harness):
    harness.send(setpoint(0, NEAR, comm_type=TOPIC))
    assert harness.answers() == []
    harness.step(0.5)
    assert not np.any(harness.joints)


@pytest.mark.invariant(4)
def test_inv4_an_estop_ends_a_stream_and_after_enable_it_does_not_go_on():
    profile = load_controller_profile('setpoints')
    controller = new_controller(load_robot_model('c3_a601s'), profile)
    controller.apply(Event.MOTORS_ON)
    framer, sent = Framer(), bytearray()
    controller.reply = sent.extend

    def send(data):
        framer.receive_data(data)
        controller.program.receive(framer.next_frame())
        code = struct.unpack_from('<4i', sent)[3]
        sent.clear()
        return code

    def wait(seconds):
        for _ in range(round(seconds / 0.02)):
            controller.step(0.02)

    def way(sequence):
        return (0.01 * sequence, 0.0, 0.0, 0.0, 0.0, 0.0)

    for sequence in range(40):
        assert send(setpoint(sequence, way(sequence))) == SUCCESS
        controller.step(0.02)
    controller.apply(Event.ESTOP_PRESS)
    assert send(setpoint(40, way(40))) == FAILURE
    wait(2.0)
    assert not controller.in_motion
    rests = controller.arm.commanded.copy()
    assert 0.2 < rests[0] < 0.5
    controller.apply(Event.ESTOP_RELEASE)
    controller.apply(Event.RESET)
    controller.apply(Event.MOTORS_ON)
    for _ in range(10):
        assert send(setpoint(41, tuple(rests))) == FAILURE  # the stream that went on
        assert send(setpoint(0, (rests[0] + 0.3, *rests[1:]))) == FAILURE  # far
        controller.step(0.02)
    np.testing.assert_array_equal(controller.arm.commanded, rests)
    assert send(setpoint(0, (rests[0] + 0.05, *rests[1:]))) == SUCCESS
    wait(1.0)
    assert controller.arm.commanded[0] == pytest.approx(rests[0] + 0.05, abs=1e-6)


@pytest.mark.invariant(9)
def test_inv9_a_setpoint_among_points_is_refused_and_none_of_the_points_is_lost(harness):
    """Nobody knows what is wanted: each point is answered, and the arm rests."""
    harness.send(point(0, FAR), point(1, NEAR), point(2, FAR))
    harness.step(0.1)
    assert harness.take_sent() == b''
    harness.send(setpoint(0, NEAR))
    sent = harness.take_sent()
    answers = [struct.unpack_from('<5i', sent, 60 * number) for number in range(3)]
    assert answers == [(56, 10, 3, FAILURE, sequence) for sequence in range(3)]
    assert sent[180:] == struct.pack('<4i', 12, 1510, 3, FAILURE)
    assert harness.error == 8000
    harness.rest()
    assert 0.0 < harness.joints[0] < FAR[0] - 0.01
    assert harness.take_sent() == b''
