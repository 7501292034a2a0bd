# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The built-in program beyond test_motion_rules.py: speed, invalid types, byte order, timers."""

import numpy as np
import pytest
from support.controller_harness import (
    FAILURE,
    LIMITS,
    SUCCESS,
    Harness,
    InlinePlanner,
    frame,
    point,
    split,
)

from epson_driver.profiles import load_controller_profile

THERE = (0.5, -0.4, 0.3, 0.2, -0.1, 1.0)
FAR = (1.5, -0.4, 0.3, 0.2, -0.1, 1.0)
TOPIC, SILENT = 1, 8004
HEARTBEAT = frame(1, TOPIC, 0)
SILENCE = frame(1, 3, FAILURE)


@pytest.mark.parametrize(
    ('velocity', 'fraction'), [(0.0, 0.5), (0.1, 0.1), (0.5, 0.5), (1.0, 0.5), (0.001, 0.001)]
)
def test_speed_is_limited_by_profile_and_point(velocity, fraction):
    harness = Harness()
    harness.send(point(0, (2.0, 0, 0, 0, 0, 0), velocity))
    fastest, before = 0.0, harness.joints
    for _ in range(400):
        harness.controller.step(0.001)
        fastest = max(
            fastest, float(np.max(np.abs(harness.joints - before) / LIMITS.velocity)) / 1e-3
        )
        before = harness.joints
    assert fastest == pytest.approx(np.float32(fraction), rel=1e-6)


def test_duration_does_not_change_a_point_to_point_move():
    times = []
    for duration in (0.0, 0.001, 10.0):
        harness = Harness()
        harness.send(point(0, THERE, 0.0, duration))
        times.append(harness.rest())
    assert len(set(times)) == 1


def test_no_point_may_be_skipped_after_an_abort():
    harness = Harness()
    harness.send(*(point(i, () if i % 2 else THERE) for i in range(5)))
    harness.step(0.1)
    harness.send(frame(11, 2, 0))
    harness.codes()
    harness.rest()
    for skipped in (5, 4, 3, 2, 1):  # point 0 was not reached
        harness.send(point(skipped))
        assert harness.codes() == [(skipped, FAILURE)]
    harness.send(point(0, THERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


def test_interrupted_point_may_be_sent_again():
    harness = Harness()
    harness.send(point(0), point(1, THERE))
    harness.step(0.1)
    harness.send(point(9, THERE))
    assert harness.codes() == [(0, SUCCESS), (1, FAILURE), (9, FAILURE)]
    harness.rest()
    harness.send(point(1, THERE))
    harness.rest()
    assert harness.codes() == [(1, SUCCESS)]


@pytest.mark.parametrize('sent', [frame(0, 2, 0), frame(0, 0, 0, bytes(52)), frame(-7, 2, 0)])
def test_message_of_invalid_type_gets_a_failure_like_a_point(sent):
    harness = Harness()
    harness.send(sent)
    assert [answer[:3] for answer in harness.replies()] == [(10, 3, FAILURE)]
    assert harness.error == 8000


def test_big_endian_controller_executes_big_endian_points():
    harness = Harness(profile=load_controller_profile('fanuc'))
    harness.send(point(0, order='>'))
    assert split(harness.peer.take(), '>') == [(10, 3, SUCCESS, bytes(44))]


def test_motors_on_clears_only_error_4031_but_reset_clears_any():
    harness = Harness(motors=False)
    harness.send(point(0, THERE))
    assert harness.error == 4031
    harness.do('motors on')
    assert harness.error == 0
    harness.send(point(0, (9.0,)))
    assert harness.error == 4001
    harness.do('motors on')
    assert harness.error == 4001
    harness.do('reset')
    assert harness.error == 0
    assert harness.controller.status().drives_powered == 1


# ---- a silent client


def test_silence_drops_an_incomplete_download():
    harness = Harness(planner=InlinePlanner())
    harness.send(HEARTBEAT, *(point(number, FAR, comm_type=TOPIC) for number in (-1, 1, 2)))
    harness.step(1.5)
    assert harness.peer.take() == SILENCE
    harness.send(point(-3, FAR, comm_type=TOPIC))
    harness.step(1.0)
    assert not harness.controller.in_motion
    assert harness.error == SILENT


def test_long_controller_steps_do_not_count_as_silence():
    """The pacer takes a scheduling delay as one step, and the messages are read after it."""
    harness = Harness(planner=InlinePlanner())
    harness.send(HEARTBEAT, point(0, np.array(FAR) / 2, 0.0, 10.0), point(1, FAR, 0.0, 10.0))
    for _ in range(5):
        harness.step(3.0, dt=3.0)
        harness.send(HEARTBEAT)
    assert harness.codes() == [(0, SUCCESS), (1, SUCCESS)]
    assert harness.controller.in_motion


@pytest.mark.parametrize('name', ['generic', 'fanuc', 'abb'])
def test_heartbeat_starts_no_timeout_in_profiles_of_other_makers(name):
    profile = load_controller_profile(name)
    harness = Harness(profile=profile)
    order = '>' if name == 'fanuc' else '<'
    harness.send(frame(1, TOPIC, 0, order=order))
    assert harness.controller.clock.timers == 0
    assert harness.peer.take() == b''
