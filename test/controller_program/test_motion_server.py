# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The motion server of the SPEL+ program beyond test_motion_rules.py, and hostile clients."""

import math
import struct
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.examples import examples
from support.robot_program import (
    FASTEST,
    HIGHEST,
    IO_PORT,
    MOTION_PORT,
    STATE_PORT,
    Client,
    RobotHarness,
    moved,
    point,
    request,
    topic,
)

from epson_driver.simple_message import (
    JointTrajPt,
    Ping,
    ReplyCode,
    SpecialSequence,
    joint_data,
)

OK, FAILURE = int(ReplyCode.SUCCESS), int(ReplyCode.FAILURE)
STOP = JointTrajPt(SpecialSequence.STOP_TRAJECTORY)
MOTORS_OFF = 4031


@pytest.fixture
def harness() -> RobotHarness:
    return RobotHarness()


@pytest.fixture
def client(harness: RobotHarness) -> Client:
    return harness.client()


def line(harness: RobotHarness, count: int, step: float = 4.0, duration: float = 0.2):
    """Return points along a line of joint 1, from where the arm is."""
    start = harness.robot.position
    return [point(n, moved(start, j1=step * (n + 1)), duration) for n in range(count)]


def close_to(a, b) -> bool:
    return all(abs(x - y) < 1e-4 for x, y in zip(a, b, strict=True))


def test_target_of_go_is_the_target_of_the_point(harness: RobotHarness, client: Client) -> None:
    """Go gets the angles of the message in binary64, multiplied by 180/pi."""
    radians = struct.unpack('<6f', struct.pack('<6f', 0.1, -0.2, 0.3, -0.4, 0.5, 3.25))
    assert harness.stream(client, [JointTrajPt(0, joint_data(radians), 0.0, 1.0)]) == [(0, OK)]
    harness.rest()
    assert harness.robot.gone_to[0][0] == tuple(radian * 57.29577951308232 for radian in radians)


def test_stream_becomes_successive_go_cp(harness: RobotHarness, client: Client) -> None:
    points = line(harness, 12)
    assert harness.stream(client, points) == [(n, OK) for n in range(12)]
    harness.rest()
    assert [cp for *_, cp in harness.robot.gone_to] == [True] * 12
    assert close_to(
        harness.robot.position, [math.degrees(joint) for joint in points[-1].joints[:6]]
    )


def test_rounding_of_speed_is_compensated(harness: RobotHarness, client: Client) -> None:
    """4 degrees in 0.2 s are 4.73 % of joint 1. Speed alternates between 4 and 5."""
    harness.stream(client, line(harness, 20))
    harness.rest()
    speeds = [speed for _, speed, *_ in harness.robot.gone_to]
    assert set(speeds) == {4.0, 5.0}
    planned = sum(4.0 / FASTEST[0] / speed * 100.0 + 0.012 for speed in speeds)
    assert abs(planned - 20 * 0.2) < 4.0 / FASTEST[0] / 4.0 * 100.0 * 0.25


def test_accel_matches_speed(harness: RobotHarness, client: Client) -> None:
    """Accelerations take BLEND_MS, so Accel equals Speed, except for short distances."""
    start = harness.robot.position
    harness.stream(client, [point(0, moved(start, j1=30.0), 0.25)])
    harness.rest()
    harness.stream(client, [point(0, moved(start, j1=29.0), 0.02)])
    harness.rest()
    (_, speed, accel, _), (_, short, quick, _) = harness.robot.gone_to
    assert accel == speed
    assert quick > short


@pytest.mark.parametrize('velocity', [1e-6, 0.0796, 0.25, 0.3])
def test_velocity_of_a_point_with_a_duration_is_rounded_up(
    harness: RobotHarness, client: Client, velocity
) -> None:
    """Otherwise each point of a stream would take longer than its duration."""
    (aimed,) = line(harness, 1, step=30.0, duration=0.1)
    harness.stream(client, [replace(aimed, velocity=velocity)])
    harness.rest()
    assert harness.robot.gone_to[0][1] == max(math.ceil(round(100.0 * velocity, 3)), 1)


def test_accel_is_at_least_1_percent() -> None:
    harness = RobotHarness(BLEND_MS='400')
    harness.stream(harness.client(), [point(0, moved(harness.robot.position, j1=4.0), 10.0)])
    harness.rest()
    assert harness.robot.gone_to[0][1:3] == (1.0, 1.0)


def test_compensated_delay_is_limited(harness: RobotHarness, client: Client) -> None:
    """A delay of at most half a second is compensated."""
    start = harness.robot.position
    slow = [point(n, moved(start, j1=4.0 * (n + 1)), 0.1, 0.02) for n in range(5)]
    harness.stream(client, slow)
    assert harness.shared('m_late') == 0.5
    harness.stream(client, [point(5, moved(start, j1=24.0), 0.2)])
    harness.rest()
    assert harness.robot.gone_to[-1][1] == 5.0


def test_limits_apply_to_a_joint_whose_pulses_descend() -> None:
    harness = RobotHarness(sign=-1)
    client = harness.client()
    assert harness.shared('g_highest').d[0] > harness.shared('g_lowest').d[0]
    outside = (HIGHEST[0] + 0.1, *harness.robot.position[1:])
    inside = (HIGHEST[0] - 0.1, *harness.robot.position[1:])
    assert harness.stream(client, [point(0, outside)]) == [(0, FAILURE)]
    assert harness.stream(client, [point(0, inside)]) == [(0, OK)]


def test_velocity_limits_speed(harness: RobotHarness, client: Client) -> None:
    start = harness.robot.position
    points = [
        point(0, moved(start, j1=20.0), 0.0, 0.3),
        point(1, moved(start, j1=40.0), 0.1, 0.1),
        point(2, moved(start, j1=60.0), 0.0, 0.0),
        point(3, moved(start, j1=60.5), 3.0, 0.001),
    ]
    harness.stream(client, points)
    harness.rest()
    assert [speed for _, speed, *_ in harness.robot.gone_to] == [30.0, 10.0, 100.0, 1.0]


def test_point_at_the_current_position_waits_for_its_duration(
    harness: RobotHarness, client: Client
) -> None:
    start = harness.robot.position
    there = moved(start, j1=10.0)
    points = [point(0, there), point(1, there, 1.0), point(2, moved(there, j1=10.0))]
    harness.stream(client, points)
    harness.rest()
    first, second = harness.robot.times
    assert len(harness.robot.gone_to) == 2
    assert second - first > 1.0 + 0.1


def test_points_in_teach_mode_are_refused(harness: RobotHarness, client: Client) -> None:
    harness.robot.states['ctrlinfo'] = 0
    assert harness.stream(client, line(harness, 1)) == [(0, FAILURE)]
    assert harness.shared('g_point_error') == MOTORS_OFF


def test_stop_ends_the_motion_within_its_deceleration(
    harness: RobotHarness, client: Client
) -> None:
    """STOP works by Till: polling (10 ms), a scan (10 ms) and braking."""
    harness.stream(client, line(harness, 6, 20.0, 1.0))
    harness.run(0.8)
    moving_to = len(harness.robot.gone_to)
    client.send(request(STOP))
    sent = harness.machine.time
    harness.run_until(lambda: harness.robot.move_now is None)
    assert harness.machine.time - sent < 0.010 + 0.010 + 0.050 + 0.010
    assert client.replies() == [(-4, OK)]
    harness.run(3.0)
    assert len(harness.robot.gone_to) == moving_to
    assert harness.robot.failures == []
    assert harness.task(1)


def test_speed_after_a_stop_is_computed_from_rest(harness: RobotHarness, client: Client) -> None:
    """The points wait until the arm is at rest, so Speed fits the distance from there."""
    harness.stream(client, line(harness, 3, 40.0, 1.0))
    harness.run(0.5)
    started = len(harness.robot.gone_to)
    client.send(request(STOP), request(point(0, moved(harness.robot.position, j1=-20.0), 1.0)))
    harness.rest()
    assert client.replies() == [(-4, OK), (0, OK)]
    target, speed, *_ = harness.robot.gone_to[started]
    origin = next(
        where for when, where in harness.robot.path if when >= harness.robot.times[started]
    )
    wanted = abs(target[0] - origin[0]) / FASTEST[0] / (1.0 - 0.012) * 100.0
    assert abs(speed - wanted) <= 1.0


def test_unanswered_points_fail_before_the_reply_to_stop() -> None:
    """Points beyond the look-ahead are unanswered when STOP arrives."""
    harness = RobotHarness(LOOK_AHEAD='4')
    client = harness.client()
    client.send(*(request(item) for item in line(harness, 8, 10.0, 1.0)))
    harness.run(0.2)
    assert client.replies() == [(n, OK) for n in range(4)]
    client.send(request(STOP))
    harness.run(0.05)
    assert client.replies() == [*((n, FAILURE) for n in range(4, 8)), (-4, OK)]


def test_ring_wraps_around(harness: RobotHarness, client: Client) -> None:
    for _ in range(9):
        points = line(harness, 30, 1.0, 0.05)
        assert harness.stream(client, points) == [(n, OK) for n in range(30)]
        harness.rest()
        back = [point(0, moved(harness.robot.position, j1=-30.0), 0.5)]
        assert harness.stream(client, back) == [(0, OK)]
        harness.rest()
    assert len(harness.robot.gone_to) == 9 * 31


def test_download_in_the_wrong_order_is_refused(harness: RobotHarness, client: Client) -> None:
    client.send(*(request(JointTrajPt(n, (0.0,) * 10, 0.1, 0.2)) for n in (-1, 2, -3)))
    harness.run(0.3)
    assert client.replies() == [(-1, OK), (2, FAILURE), (-3, FAILURE)]
    client.send(*(request(JointTrajPt(n, (9.0,) * 10, 0.1, 0.2)) for n in (-1, 0)))
    client.send(request(line(harness, 1)[0]))
    harness.run(0.3)
    assert client.replies() == [(-1, FAILURE), (0, FAILURE), (0, OK)]


def test_next_go_starts_without_a_pause(harness: RobotHarness, client: Client) -> None:
    """The program does not wait between two Go statements."""
    harness.stream(client, line(harness, 10))
    harness.rest()
    started = harness.robot.times
    for (one, (_, speed, *_)), two in zip(
        zip(started, harness.robot.gone_to, strict=True), started[1:], strict=False
    ):
        assert two - one < 4.0 / FASTEST[0] / speed * 100.0 + 0.011
    rested = [
        one[1] == two[1]
        for one, two in pairwise(harness.robot.path)
        if started[0] < one[0] < started[-1]
    ]
    assert sum(rested) <= len(started)


def test_single_point_is_executed_without_waiting_for_more(
    harness: RobotHarness, client: Client
) -> None:
    begin = harness.robot.now
    assert harness.stream(client, line(harness, 1)) == [(0, OK)]
    harness.rest()
    assert harness.robot.times[0] - begin < 0.07


def test_arm_waits_for_each_of_the_first_points(harness: RobotHarness, client: Client) -> None:
    for item in line(harness, 2):
        client.send(request(item))
        harness.run(0.02)
        assert not harness.robot.times
    harness.rest()
    assert len(harness.robot.times) == 2


def test_motion_port_has_the_configured_address(harness: RobotHarness, client: Client) -> None:
    settings = harness.robot.sockets[MOTION_PORT].settings
    assert (settings.host, settings.tcp_port) == ('192.168.0.2', 11000)
    assert client.open


# ---- a silent client


HEARTBEAT = topic(Ping())


def slow(harness: RobotHarness, count: int = 4) -> list:
    """Return requests for points that take the arm some seconds."""
    return [request(item) for item in line(harness, count, step=10.0, duration=2.0)]


def test_client_may_be_silent_without_main(harness: RobotHarness, client: Client) -> None:
    client.send(HEARTBEAT, *slow(harness, 12))
    harness.run(0.3)
    harness.press_estop()
    harness.run(5.0)
    assert harness.shared('g_point_error') == 0
    harness.robot.states['estopon'] = 0
    harness.enable()
    client.packets()
    assert harness.stream(client, [point(0, harness.robot.position, 0.1)]) == [(0, OK)]


POINT_BYTES = 52
"""Size of the body of a JOINT_TRAJ_PT. Joint 1 is at 9 rad, so no point is valid."""

EDGES = [-(2**31), 2**31 - 1, -5, -4, -3, -2, -1, 0, 1, 2, 3, 10, 11, 12, 13, 64, 1000, 65200]

WORDS = st.one_of(st.sampled_from(EDGES), st.integers(-(2**31), 2**31 - 1))

KINDS = st.one_of(st.sampled_from([1, 2, 10, 11, 11, 11, *range(65200, 65207)]), WORDS)

BODIES = st.one_of(
    st.lists(WORDS, max_size=30)
    .filter(lambda words: len(words) != POINT_BYTES // 4)
    .map(lambda words: struct.pack(f'<{len(words)}i', *words)),
    st.binary(max_size=80).filter(lambda body: len(body) != POINT_BYTES),
    st.builds(
        lambda sequence, floats: struct.pack('<i12f', sequence, 9.0, *floats[1:]),
        st.sampled_from(EDGES),
        st.lists(
            st.sampled_from([float('nan'), float('inf'), 1e38, -1e38, 1e-45, 9.0, -0.5, 1e9]),
            min_size=12,
            max_size=12,
        ),
    ),
)


def _frame(kind: int, comm: int, code: int, body: bytes) -> bytes:
    return struct.pack('<iiii', 12 + len(body), kind, comm, code) + body


FRAMES = st.builds(
    _frame, KINDS, st.sampled_from([1, 2, 2, 2, 3, 0, 9]), st.sampled_from([0, 0, 0, 1, 7]), BODIES
)

CHUNKS = st.lists(st.one_of(FRAMES, FRAMES, FRAMES, st.binary(max_size=40)), max_size=12)


@settings(max_examples=examples(25), deadline=None, suppress_health_check=list(HealthCheck))
@given(port=st.sampled_from([STATE_PORT, MOTION_PORT, IO_PORT]), chunks=CHUNKS, cut=st.booleans())
def test_hostile_frames_move_nothing(port: int, chunks: list[bytes], cut: bool) -> None:
    harness = RobotHarness(LOST_CLIENT_MOTORS_OFF='')
    client = harness.client(port)
    for chunk in chunks:
        if client.open:
            client.send_bytes(chunk)
            if cut:
                harness.run(0.02)
    harness.run(0.5)
    client.leave()
    harness.run(1.0)
    assert harness.robot.gone_to == []
    assert harness.robot.failures == []
    assert all(harness.task(number) for number in (1, 65, 66, 67, 68))
    good = harness.client()
    start = harness.robot.position
    points = [point(n, moved(start, j1=n + 1.0)) for n in range(3)]
    assert harness.stream(good, points) == [(0, 1), (1, 1), (2, 1)]
    harness.rest()
    assert abs(harness.robot.position[0] - 3.0) < 1e-4
