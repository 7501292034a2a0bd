# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""state.prg: JOINT_POSITION every 10 ms, STATUS after ten and at a stop of the arm."""

import math
from itertools import pairwise

import pytest
from support.robot_program import PULSES, STATE_PORT, Client, RobotHarness, point

from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    JointPosition,
    Mode,
    Opaque,
    Ping,
    ReplyCode,
    Status,
    encode,
    joint_data,
    reply,
    request,
    topic,
)

BATTERY = 8
"""A number for SysErr."""


@pytest.fixture
def harness() -> RobotHarness:
    return RobotHarness()


@pytest.fixture
def client(harness: RobotHarness) -> Client:
    client = harness.client(STATE_PORT)
    client.packets()
    return client


def status(harness: RobotHarness, client: Client) -> Status:
    """Return the last STATUS within a quarter of a second."""
    client.packets()
    harness.run(0.25)
    return [packet.message for packet in client.packets() if isinstance(packet.message, Status)][
        -1
    ]


def test_joints_are_the_encoder_values_in_binary32(harness: RobotHarness, client: Client) -> None:
    """RealPls times degrees per pulse, rounded once to binary32."""
    harness.robot.joints = (12.3456789, -98.7654321, 1.1e-4, 179.9, -0.5, 0.0)
    harness.run(0.02)
    client.raw()
    harness.run(0.15)
    per_pulse = harness.shared('g_per_pulse').d
    pulses = [round(a * b) for a, b in zip(harness.robot.joints, PULSES, strict=True)]
    radians = [n * k * 0.017453292519943295 for n, k in zip(pulses, per_pulse, strict=True)]
    expected = encode(topic(JointPosition(0, joint_data(radians))), LITTLE_ENDIAN)
    got = client.raw()
    assert expected in got
    assert got.count(b'\x38\0\0\0\x0a\0\0\0\x01\0\0\0\0\0\0\0') == got.count(expected)


def test_degrees_per_pulse_are_exact_within_a_pulse(harness: RobotHarness) -> None:
    for joint, (held, pulses) in enumerate(
        zip(harness.shared('g_per_pulse').d, PULSES, strict=True)
    ):
        assert abs(360.0 / held - 360.0 * pulses) < 2.5, joint
    assert harness.shared('g_zero').d == [0.0] * 6


def test_joint_position_every_10_ms_and_status_after_ten(
    harness: RobotHarness, client: Client
) -> None:
    harness.run(10.0)
    kinds = [type(packet.message) for packet in client.packets()]
    assert 990 <= len(kinds) <= 1010
    period = kinds.index(Status)
    beats = [n for n, kind in enumerate(kinds) if kind is Status]
    assert period <= 10
    assert {b - a for a, b in pairwise(beats)} == {11}


def test_status_is_bit_exact(harness: RobotHarness, client: Client) -> None:
    client.raw()
    harness.run(0.3)
    expected = Status(1, 0, 0, 0, 0, Mode.AUTO, 1)
    assert encode(topic(expected), LITTLE_ENDIAN) in client.raw()


def test_every_field_of_status_shows_its_condition(harness: RobotHarness, client: Client) -> None:
    assert status(harness, client) == Status(1, 0, 0, 0, 0, Mode.AUTO, 1)
    harness.robot.motors = False
    assert status(harness, client) == Status(0, 0, 0, 0, 0, Mode.AUTO, 0)
    harness.robot.motors = True
    harness.robot.states['ctrlinfo'] = 0
    assert status(harness, client) == Status(1, 0, 0, 0, 0, Mode.MANUAL, 0)
    harness.robot.states.update(ctrlinfo=1, pauseon=-1)
    assert status(harness, client) == Status(1, 0, 0, 0, 0, Mode.AUTO, 0)
    harness.robot.states.update(pauseon=0, erroron=-1, syserr=BATTERY)
    assert status(harness, client) == Status(1, 0, BATTERY, 1, 0, Mode.AUTO, 0)
    harness.robot.states.update(erroron=0, syserr=0)
    harness.press_estop()
    assert status(harness, client) == Status(0, 1, 2261, 0, 0, Mode.AUTO, 0)
    harness.enable()
    assert status(harness, client) == Status(1, 0, 0, 0, 0, Mode.AUTO, 1)


def test_status_shows_motion_and_errors(harness: RobotHarness, client: Client) -> None:
    motion = harness.client()
    harness.stream(motion, [point(0, [90.0, 0.0, 0.0, 0.0, 30.0, 0.0], 3.0)])
    harness.run(0.5)
    assert status(harness, client).in_motion == 1
    harness.rest()
    assert status(harness, client).in_motion == 0
    harness.stream(motion, [point(0, [math.inf] * 6)])
    assert status(harness, client).error_code == 8000
    harness.robot.fails_with = 4242
    harness.stream(motion, [point(0, [80.0, 0.0, 0.0, 0.0, 30.0, 0.0])])
    harness.run(0.5)
    assert status(harness, client).error_code == 4242


def test_status_is_sent_when_the_arm_stops(harness: RobotHarness, client: Client) -> None:
    motion = harness.client()
    client.packets()
    harness.stream(motion, [point(0, [90.0, 0.0, 0.0, 0.0, 30.0, 0.0], 3.0)])
    moving = []
    for _ in range(600):
        harness.run(0.01)
        reported = [item.message for item in client.packets() if isinstance(item.message, Status)]
        moves = harness.robot.move_now is not None
        moving.append((moves, reported[-1].in_motion if reported else None))
    stops = [n for n in range(1, len(moving)) if moving[n - 1][0] and not moving[n][0]]
    assert len(stops) == 1
    assert 0 in [word for _, word in moving[stops[0] : stops[0] + 4]]


def test_arm_at_rest_with_pending_points_is_in_motion(
    harness: RobotHarness, client: Client
) -> None:
    motion = harness.client()
    harness.stream(motion, [point(0, list(harness.robot.joints), 1.0)])  # a dwell
    harness.run(0.3)
    assert harness.robot.move_now is None
    assert status(harness, client).in_motion == 1
    harness.robot.states.update(pauseon=-1)
    assert status(harness, client).in_motion == 0
    harness.robot.states.update(pauseon=0)
    harness.run(1.0)
    assert status(harness, client).in_motion == 0


def test_requests_are_answered_between_the_messages(harness: RobotHarness, client: Client) -> None:
    client.send(request(Ping()), request(Opaque(1599)))
    harness.run(0.2)
    got = [packet for packet in client.packets() if packet.reply_code]
    assert got == [reply(Ping(), ReplyCode.SUCCESS), reply(Opaque(1599), ReplyCode.FAILURE)]


def test_next_client_is_served_after_a_lost_one(harness: RobotHarness, client: Client) -> None:
    for _ in range(3):
        client.leave()
        harness.run(0.5)
        assert not client.open
        client = harness.client(STATE_PORT)
        assert len(client.packets()) > 10
    assert harness.robot.failures == []


def test_client_with_invalid_lengths_is_disconnected(
    harness: RobotHarness, client: Client
) -> None:
    client.send_bytes(b'\xff' * 100)
    harness.run(0.3)
    assert not client.open
    half = harness.client(STATE_PORT)
    half.send_bytes(b'\x20\0\0\0\x01')
    harness.run(0.5)
    assert half.open
    harness.run(1.0)
    assert not half.open
    assert harness.client(STATE_PORT).packets()


def test_busy_controller_sends_later_but_not_more(harness: RobotHarness, client: Client) -> None:
    """After a gap the messages continue at their rate. Missed ones are skipped."""
    task = next(item for item in harness.machine.world.tasks.values() if item.number == 67)
    task.halted = True
    harness.run(2.0)
    client.packets()
    task.halted = False
    harness.run(1.0)
    assert len(client.packets()) <= 105
