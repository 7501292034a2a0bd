# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""state.prg: JOINT_POSITION every 10 ms, STATUS after ten and at a stop of the arm."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from support.controller_harness import MODEL, point
from support.spel_program_harness import OurProgramHarness

from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.simple_message import Mode, Opaque, Ping, ReplyCode, Status, reply, request

FAR = (1.5, 0.0, 0.0, 0.0, 0.5, 0.0)
READY = Status(1, 0, 0, 0, 0, Mode.AUTO, 1)


@pytest.fixture
def harness():
    harness = OurProgramHarness()
    harness.do('motors on')
    return harness


@pytest.fixture
def state(harness):
    return harness.connect('state')


def statuses(client):
    """Return the STATUS messages since the last call."""
    return [item.message for item in client.packets() if isinstance(item.message, Status)]


def test_degrees_per_pulse_are_exact_within_a_pulse(harness, state):
    per_degree = MODEL.pulses_per_unit / MODEL.shown_per_unit
    held = np.array(harness.variable('g_per_pulse').d)
    assert np.abs(360.0 / held - 360.0 * per_degree).max() < 2.5
    assert harness.variable('g_zero').d == [0.0] * 6


def test_joint_position_every_10_ms_and_status_after_ten(harness, state):
    state.packets()
    harness.step(10.0)
    kinds = [type(packet.message) for packet in state.packets()]
    assert 990 <= len(kinds) <= 1010
    beats = [n for n, kind in enumerate(kinds) if kind is Status]
    assert beats[0] <= 10
    assert {b - a for a, b in pairwise(beats)} == {11}


def test_every_field_of_status_shows_its_condition(harness, state):
    off = replace(READY, drives_powered=0, motion_possible=0)
    ended = replace(off, error_code=2261)
    stopped = replace(ended, e_stopped=1, in_error=1)
    for event, expected in (
        ('', READY),
        ('motors off', off),
        ('motors on', READY),
        ('pause', replace(READY, motion_possible=0)),
        ('continue', READY),
        ('mode manual', replace(off, mode=Mode.MANUAL)),
        ('mode auto', off),
        ('motors on', READY),
        ('E-stop press', stopped),
        ('E-stop release', stopped),
        ('reset', ended),
        ('start', off),
        ('motors on', READY),
    ):
        if event:
            harness.do(event)
        assert state.status() == expected, event
    harness.controller.servo_error(0)
    assert state.status() == replace(off, error_code=ErrorNumber.SERVO_ERROR, in_error=1)


def test_status_shows_motion_and_errors(harness, state):
    motion = harness.connect()
    motion.stream(point(0, FAR, 0.0, 3.0))
    harness.step(0.5)
    assert state.status().in_motion == 1
    harness.rest()
    assert state.status().in_motion == 0
    motion.stream(point(0, [math.inf] * 6))
    assert state.status().error_code == 8000
    motion.stream(point(0))
    assert state.status().error_code == 0


@pytest.mark.parametrize('duration', [1.0, 1.02, 1.04, 1.06, 1.08])
def test_status_is_sent_when_the_arm_stops(harness, state, duration):
    """Whenever that is, within the 110 ms between two STATUS."""
    harness.connect().stream(point(0, FAR, 0.0, duration))
    harness.until(lambda: harness.controller.in_motion)
    harness.until(lambda: not harness.controller.in_motion)
    statuses(state)
    harness.step(0.03)
    assert statuses(state)[-1].in_motion == 0


def test_arm_at_rest_with_pending_points_is_in_motion(harness, state):
    harness.connect().stream(point(0, harness.position, 0.0, 1.0))  # a dwell
    harness.step(0.1)
    assert not harness.controller.in_motion
    assert state.status().in_motion == 1
    harness.do('pause')
    assert state.status().in_motion == 0
    harness.do('continue')
    harness.step(1.0)
    assert state.status().in_motion == 0


def test_requests_are_answered_between_the_messages(harness, state):
    state.send(request(Ping()), request(Opaque(1599)))
    harness.step(0.2)
    got = [packet for packet in state.packets() if packet.reply_code]
    assert got == [reply(Ping(), ReplyCode.SUCCESS), reply(Opaque(1599), ReplyCode.FAILURE)]


def test_client_with_invalid_lengths_is_disconnected(harness, state):
    state.send_bytes(b'\xff' * 100)
    harness.step(0.3)
    assert not state.open
    half = harness.connect('state')
    half.send_bytes(b'\x20\0\0\0\x01')
    harness.step(0.5)
    assert half.open
    harness.step(1.0)
    assert not half.open
    assert harness.connect('state').packets()


def test_busy_controller_sends_later_but_not_more(harness, state):
    """After a gap the messages continue at their rate. Missed ones are skipped."""
    task = harness.controller.program.machine.world.tasks[67]
    task.halted = True
    harness.step(2.0)
    state.packets()
    task.halted = False
    harness.step(1.0)
    assert len(state.packets()) <= 105
