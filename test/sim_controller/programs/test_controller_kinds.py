# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Special behaviour of the profiles: lost client, blending, time, state messages."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from support.controller_harness import (
    LIMITS,
    MODEL,
    STOP,
    SUCCESS,
    Harness,
    InlinePlanner,
    Peer,
    frame,
    point,
    split,
)

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.sim_controller.condition.states import Motors
from epson_driver.simple_message import ByteOrder

START_TRAJ_MODE, STOP_MOTION, CHECK_MOTION_READY = 200121, 200111, 200101
THERE = (0.5, -0.4, 0.3, 0.2, -0.1, 0.6)


def new_harness(name, smooth=True, **changes):
    """Return a controller of a kind, little endian and without servo lag, with a client."""
    profile = load_controller_profile(name)
    profile = replace(
        profile,
        byte_order=ByteOrder.LITTLE,
        servo=replace(profile.servo, lag=0.0, encoder=False),
        **changes,
    )
    return Harness(profile=profile, planner=InlinePlanner() if smooth else None, model=MODEL)


def command(code, sequence=0):
    return frame(2001, 2, 0, struct.pack('<3i', 0, sequence, code) + bytes(40))


def motoman_point(sequence, joints, time):
    ten = [*joints, *[0.0] * (10 - len(joints))]
    body = struct.pack('<3if', 0, sequence, 7, time) + struct.pack('<10f', *ten) + bytes(80)
    return frame(14, 2, 0, body)


def results(harness):
    """Return (command, result, subcode) of the MOTION_REPLYs since the last call."""
    return [struct.unpack_from('<3i', body, 8) for *_, body in split(harness.peer.take())]


def moving_motoman(smooth=True):
    """Return a Motoman that moves at 0.5 rad/s, and its last accepted point."""
    harness = new_harness('motoman', smooth)
    harness.send(command(START_TRAJ_MODE), motoman_point(0, (), 0.0))
    accepted = 0
    for index in range(1, 41):
        for _ in range(1000):
            harness.send(motoman_point(index, (0.05 * index,), 0.1 * index))
            if results(harness)[-1] == (14, 0, 0):
                accepted = index
                break
            harness.step(0.004)
            if harness.joints[0] > 0.4:
                return harness, accepted
    raise AssertionError('it took all points without moving')


def status(harness):
    return harness.controller.status()


@pytest.mark.invariant(4)
@pytest.mark.parametrize('smooth', [True, False])
def test_inv4_motoman_continues_its_queue_for_the_next_client(smooth):
    harness, accepted = moving_motoman(smooth)
    harness.disconnect()
    harness.step(2.0)
    stopped = harness.joints[0]
    assert stopped < 0.6
    assert harness.condition.motors is Motors.ON
    assert (status(harness).drives_powered, status(harness).motion_possible) == (1, 1)
    assert status(harness).in_motion == 1  # its queue is not empty
    harness.step(5.0)
    assert harness.joints[0] == stopped

    harness.connect()  # it moves without any message
    harness.step(3.0)
    reached = harness.joints[0]
    assert reached > stopped + 0.05
    assert reached <= 0.05 * accepted + 1e-6
    assert status(harness).in_motion == 0
    harness.send(command(CHECK_MOTION_READY))
    assert results(harness) == [(CHECK_MOTION_READY, 0, 0)]


@pytest.mark.invariant(3, 4)
def test_inv4_stop_motion_of_the_next_client_empties_the_queue():
    harness, _ = moving_motoman()
    harness.disconnect()
    harness.step(1.0)
    stopped = harness.joints[0]
    harness.connect()
    harness.send(command(STOP_MOTION))
    assert results(harness) == [(STOP_MOTION, 0, 0)]
    harness.step(3.0)
    assert harness.joints[0] == pytest.approx(stopped, abs=1e-9)
    assert status(harness).in_motion == 0


def test_servos_off_empties_the_queue_of_a_motoman():
    for event in ('motors off', 'E-stop press'):
        harness, _ = moving_motoman()
        harness.disconnect()
        harness.step(1.0)
        stopped = harness.joints[0]
        harness.do(event)
        harness.connect()
        harness.step(2.0)
        assert harness.joints[0] == stopped
        assert status(harness).in_motion == 0


def test_motoman_is_busy_if_a_second_of_points_is_queued():
    harness = new_harness('motoman')
    harness.send(command(START_TRAJ_MODE), motoman_point(0, (), 0.0))
    results(harness)
    answers = []
    for index in range(1, 21):
        harness.send(motoman_point(index, (0.05 * index,), 0.1 * index))
        answers += [result for _, result, _ in results(harness)]
        if answers[-1] != 0:
            break
    assert answers[-1] == 1  # BUSY
    assert 8 <= len(answers) - 1 <= 10  # 0.8 s, the current point and the waiting one


def test_motoman_status_shows_readiness_and_alarms_only():
    harness = new_harness('motoman')
    assert (status(harness).drives_powered, status(harness).motion_possible) == (1, 0)
    harness.send(command(START_TRAJ_MODE))
    assert status(harness).motion_possible == 1
    harness.do('E-stop press')
    state = status(harness)
    assert (state.e_stopped, state.in_error, state.error_code) == (1, 0, 0)
    assert (state.drives_powered, state.motion_possible) == (0, 0)
    harness.do('E-stop release', 'reset')
    harness.controller.raise_error(ErrorNumber.SERVO_ERROR)
    assert status(harness).in_error == 1


def test_motoman_feedback_has_no_time():
    harness = new_harness('motoman')
    state = Peer()
    harness.controller.connect('state', state)
    harness.step(0.09)
    frames = split(state.take())
    assert [msg_type for msg_type, *_ in frames] == [15, 13] * 4  # both every 25 ms
    assert struct.unpack_from('<2if', frames[0][3]) == (0, 6, 0.0)


def test_fanuc_sends_joints_every_24_ms_and_status_every_twelfth():
    harness = new_harness('fanuc')
    state = Peer()
    harness.controller.connect('state', state)
    harness.step(0.024 * 21.5)
    assert [msg_type for msg_type, *_ in split(state.take())] == ([10] * 11 + [13]) * 2


@pytest.mark.invariant(4)
@pytest.mark.parametrize('smooth', [True, False])
def test_inv4_fanuc_executes_acknowledged_points_of_a_lost_client(smooth):
    harness = new_harness('fanuc', smooth)
    harness.send(*(point(index, np.multiply(THERE, 0.1 * index)) for index in range(11)))
    harness.step(0.3)
    acknowledged = harness.codes()[-1][0]
    assert 1 <= acknowledged < 9
    harness.disconnect()
    harness.rest()
    assert harness.joints == pytest.approx(np.multiply(THERE, 0.1 * acknowledged), abs=1e-6)
    assert harness.condition.motors is Motors.ON
    harness.connect()
    harness.step(1.0)
    assert harness.codes() == []  # no replies to points of the old client
    harness.send(point(0, THERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


@pytest.mark.invariant(3, 4)
def test_inv3_stop_of_the_next_client_brakes_a_fanuc():
    harness = new_harness('fanuc')
    harness.send(point(0, THERE))
    harness.step(0.2)
    harness.disconnect()
    harness.connect()
    assert harness.controller.in_motion
    harness.send(point(STOP))
    harness.rest()
    assert (STOP, SUCCESS) in harness.codes()
    assert harness.joints[0] < 0.4


@pytest.mark.parametrize('smooth', [True, False])
def test_fanuc_does_not_stop_at_intermediate_points(smooth):
    harness = new_harness('fanuc', smooth)
    harness.send(*(point(index, np.multiply(THERE, 0.1 * index)) for index in range(11)))
    trace = harness.run()
    steps = np.abs(np.diff(trace[:, 0]))
    moves = np.flatnonzero(steps > 1e-7)
    assert np.min(steps[moves[0] : moves[-1] + 1][20:-20]) > 1e-5
    assert harness.joints == pytest.approx(THERE, abs=1e-6)


@pytest.mark.invariant(4)
@pytest.mark.parametrize('complete', [True, False])
def test_inv4_abb_executes_only_complete_downloads_of_a_lost_client(complete):
    harness = new_harness('abb')
    harness.send(point(-1, (), 0.0, 0.1, comm_type=1))
    harness.send(
        *(point(i, np.multiply(THERE, 0.1 * i), 0, 0.2, comm_type=1) for i in range(1, 10))
    )
    if complete:
        harness.send(point(-3, THERE, 0.0, 0.2, comm_type=1))
    harness.step(0.2)
    harness.disconnect()
    harness.rest()
    assert harness.joints == pytest.approx(THERE if complete else (0.0,) * 6, abs=1e-6)
    assert harness.condition.motors is Motors.ON


@pytest.mark.invariant(2)
def test_inv2_ptp_move_of_an_abb_takes_its_duration():
    harness = new_harness('abb', smooth=False)
    plan = np.outer(0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 12)), THERE)
    period = 0.25
    harness.send(point(-1, plan[0], 0.0, 10.0, comm_type=1))
    harness.send(*(point(i, plan[i], 0.0, period, comm_type=1) for i in range(1, 11)))
    harness.send(point(-3, plan[11], 0.0, period, comm_type=1))
    dt = 0.001
    trace = harness.run(dt=dt)
    assert (len(trace) - 1) * dt == pytest.approx(11 * period, rel=0.01)
    assert harness.joints == pytest.approx(THERE, abs=1e-6)
    for order, limit in ((1, LIMITS.velocity), (2, LIMITS.acceleration)):
        differences = np.abs(np.diff(trace, order, axis=0)) / dt**order
        assert np.all(differences <= limit * 1.001 + 2e-7 / dt**order)  # float32
    moves = np.max(np.abs(np.diff(trace, axis=0)), axis=1)
    assert np.min(moves[50:-50]) > 1e-6  # it still blends


@pytest.mark.parametrize('size', [0, 40, 44, 52])
def test_ping_with_a_leftover_body_is_answered(size):
    """The C++ library sends one when it reuses the object of another message."""
    harness = new_harness('motoman')
    harness.send(frame(1, 2, 0, b'\x01' * size))
    body = bytes(size if size == 40 else 0)
    assert harness.peer.take() == frame(1, 3, SUCCESS, body)
