# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""motion.prg and main.prg: points in, checks, truthful replies, Go … CP, STOP."""

import math
import struct
from itertools import pairwise

import pytest
from support.robot_program import (
    FASTEST,
    HIGHEST,
    LOWEST,
    MOTION_PORT,
    Client,
    RobotHarness,
    moved,
    point,
    request,
    topic,
)

from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    GetVersion,
    JointPosition,
    JointTrajPt,
    MessageType,
    Opaque,
    Ping,
    ReplyCode,
    SpecialSequence,
    encode,
    joint_data,
    reply,
)

OK, FAILURE = int(ReplyCode.SUCCESS), int(ReplyCode.FAILURE)
STOP = JointTrajPt(SpecialSequence.STOP_TRAJECTORY)
CORRUPT, OUT_OF_RANGE, MOTORS_OFF, TASK_GONE = 8000, 4001, 4031, 2261


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


def test_replies_are_bit_exact(harness: RobotHarness, client: Client) -> None:
    """Each reply is the JOINT_POSITION that simple_message writes, with the request's sequence."""
    first, second = line(harness, 2)
    client.send(request(first))
    harness.run(0.05)
    assert client.raw() == encode(reply(JointPosition(0), ReplyCode.SUCCESS), LITTLE_ENDIAN)
    client.send(request(second))
    harness.run(0.05)
    assert client.raw() == encode(reply(JointPosition(1), ReplyCode.SUCCESS), LITTLE_ENDIAN)
    client.send(request(STOP))
    harness.run(0.05)
    assert client.raw() == encode(reply(JointPosition(-4), ReplyCode.SUCCESS), LITTLE_ENDIAN)
    client.send(request(JointTrajPt(7)))
    harness.run(0.05)
    assert client.raw() == encode(reply(JointPosition(7), ReplyCode.FAILURE), LITTLE_ENDIAN)


def test_the_target_of_go_is_that_of_the_point(harness: RobotHarness, client: Client) -> None:
    """The angles of Go are those of the message, in binary64, times 180/pi."""
    radians = struct.unpack('<6f', struct.pack('<6f', 0.1, -0.2, 0.3, -0.4, 0.5, 3.25))
    assert harness.stream(client, [JointTrajPt(0, joint_data(radians), 0.0, 1.0)]) == [(0, OK)]
    harness.rest()
    assert harness.robot.gone_to[0][0] == tuple(each * 57.29577951308232 for each in radians)


def test_a_stream_is_one_chain_of_go_cp(harness: RobotHarness, client: Client) -> None:
    points = line(harness, 12)
    assert harness.stream(client, points) == [(n, OK) for n in range(12)]
    harness.rest()
    assert [cp for *_, cp in harness.robot.gone_to] == [True] * 11 + [False]
    assert close_to(harness.robot.position, [math.degrees(each) for each in points[-1].joints[:6]])


def test_rounding_of_speed_is_carried_on(harness: RobotHarness, client: Client) -> None:
    """4 degrees in 0.2 s are 4.73 % of joint 1: Speed 4 and 5 in turn keep the whole time."""
    harness.stream(client, line(harness, 20))
    harness.rest()
    speeds = [speed for _, speed, *_ in harness.robot.gone_to]
    assert set(speeds) == {4.0, 5.0}
    planned = sum(4.0 / FASTEST[0] / speed * 100.0 + 0.012 for speed in speeds)
    assert abs(planned - 20 * 0.2) < 4.0 / FASTEST[0] / 4.0 * 100.0 * 0.25


def test_accel_fits_speed(harness: RobotHarness, client: Client) -> None:
    """Accelerations take BLEND_MS, so that Accel is Speed; on a short way they are quicker."""
    start = harness.robot.position
    harness.stream(client, [point(0, moved(start, j1=30.0), 0.25)])
    harness.rest()
    harness.stream(client, [point(0, moved(start, j1=29.0), 0.02)])
    harness.rest()
    (_, speed, accel, _), (_, short, quick, _) = harness.robot.gone_to
    assert accel == speed
    assert quick > short


def test_accel_is_at_least_1_percent() -> None:
    harness = RobotHarness(BLEND_MS='400')
    harness.stream(harness.client(), [point(0, moved(harness.robot.position, j1=4.0), 10.0)])
    harness.rest()
    assert harness.robot.gone_to[0][1:3] == (1.0, 1.0)


def test_what_cannot_be_made_up_for_is_forgotten(harness: RobotHarness, client: Client) -> None:
    """An arm that was held back does not hurry for long: half a second is carried on."""
    start = harness.robot.position
    slow = [point(n, moved(start, j1=4.0 * (n + 1)), 0.1, 0.02) for n in range(5)]
    harness.stream(client, slow)
    assert harness.shared('m_late') == 0.5
    harness.stream(client, [point(5, moved(start, j1=24.0), 0.2)])
    harness.rest()
    assert harness.robot.gone_to[-1][1] == 5.0


def test_joints_whose_pulses_count_down() -> None:
    harness = RobotHarness(sign=-1)
    client = harness.client()
    assert harness.shared('g_highest').d[0] > harness.shared('g_lowest').d[0]
    outside = (HIGHEST[0] + 0.1, *harness.robot.position[1:])
    inside = (HIGHEST[0] - 0.1, *harness.robot.position[1:])
    assert harness.stream(client, [point(0, outside)]) == [(0, FAILURE)]
    assert harness.stream(client, [point(0, inside)]) == [(0, OK)]


def test_velocity_caps_speed(harness: RobotHarness, client: Client) -> None:
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


def test_the_arm_stands_for_the_time_of_a_point_that_is_where_it_is(
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


@pytest.mark.parametrize(
    'bad',
    [
        JointTrajPt(1, joint_data([math.nan] * 6), 0.1, 0.2),
        JointTrajPt(1, (0.0,) * 9 + (math.inf,), 0.1, 0.2),
        JointTrajPt(1, (0.0,) * 10, math.nan, 0.2),
        JointTrajPt(1, (0.0,) * 10, -0.1, 0.2),
        JointTrajPt(1, (0.0,) * 10, 1.5, 0.2),
        JointTrajPt(1, (0.0,) * 10, 0.1, -1.0),
        JointTrajPt(1, (0.0,) * 10, 0.1, 1e5),
        JointTrajPt(1, (0.0,) * 10, 0.1, -math.inf),
        JointTrajPt(2, (0.0,) * 10, 0.1, 0.2),
        JointTrajPt(-3, (0.0,) * 10, 0.1, 0.2),
        JointTrajPt(-5, (0.0,) * 10, 0.1, 0.2),
    ],
    ids=str,
)
def test_a_point_that_makes_no_sense_is_refused_and_ends_the_motion(
    harness: RobotHarness, client: Client, bad: JointTrajPt
) -> None:
    (good,) = line(harness, 1, 90.0, 2.0)
    assert harness.stream(client, [good, bad]) == [(0, OK), (bad.sequence, FAILURE)]
    assert harness.shared('g_point_error') == CORRUPT
    harness.rest()
    assert abs(harness.robot.position[0] - 90.0) > 10.0
    assert harness.stream(client, line(harness, 2)) == [(0, OK), (1, OK)]
    assert harness.shared('g_point_error') == 0


@pytest.mark.parametrize('joint', range(6))
@pytest.mark.parametrize('side', [LOWEST, HIGHEST], ids=['lowest', 'highest'])
def test_a_point_outside_the_limits_is_refused_before_it_is_queued(
    harness: RobotHarness, client: Client, joint: int, side: tuple[float, ...]
) -> None:
    inside, outside = list(harness.robot.position), list(harness.robot.position)
    inside[joint] = side[joint]
    outside[joint] = side[joint] + math.copysign(0.01, side[joint])
    assert harness.stream(client, [point(0, outside)]) == [(0, FAILURE)]
    assert harness.shared('g_point_error') == OUT_OF_RANGE
    assert harness.robot.gone_to == []
    assert harness.stream(client, [point(0, inside, 3.0)]) == [(0, OK)]
    harness.rest()
    assert harness.robot.failures == []
    assert abs(harness.robot.position[joint] - side[joint]) < 0.001


def test_what_is_not_a_request_with_a_whole_body_is_refused(
    harness: RobotHarness, client: Client
) -> None:
    client.send(request(Opaque(MessageType.JOINT_TRAJ_PT, bytes(48))))
    harness.run(0.05)
    assert client.replies() == [(0, FAILURE)]
    client.send(reply(JointTrajPt(0), ReplyCode.SUCCESS), topic(JointTrajPt(3)))
    harness.run(0.05)
    assert client.replies() == []
    assert harness.robot.gone_to == []


def test_the_motors_must_be_on(harness: RobotHarness, client: Client) -> None:
    harness.robot.motors = False
    assert harness.stream(client, line(harness, 1)) == [(0, FAILURE)]
    assert harness.shared('g_point_error') == MOTORS_OFF
    harness.robot.motors = True
    harness.rest()
    assert harness.robot.gone_to == []
    assert harness.stream(client, line(harness, 1)) == [(0, OK)]


def test_in_the_teach_mode_points_are_refused(harness: RobotHarness, client: Client) -> None:
    harness.robot.states['ctrlinfo'] = 0
    assert harness.stream(client, line(harness, 1)) == [(0, FAILURE)]
    assert harness.shared('g_point_error') == MOTORS_OFF


def test_stop_ends_the_motion_within_its_deceleration(
    harness: RobotHarness, client: Client
) -> None:
    """STOP through Till: the arm stands after polling (10 ms), a scan (10 ms) and braking."""
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


def test_after_a_stop_only_a_new_trajectory_is_taken(
    harness: RobotHarness, client: Client
) -> None:
    assert harness.stream(client, [*line(harness, 3), STOP]) == [
        (0, OK),
        (1, OK),
        (2, OK),
        (-4, OK),
    ]
    assert harness.stream(client, [point(3, harness.robot.position)]) == [(3, FAILURE)]
    harness.rest()
    assert harness.stream(client, line(harness, 2)) == [(0, OK), (1, OK)]


def test_a_new_trajectory_after_a_stop_begins_from_rest(
    harness: RobotHarness, client: Client
) -> None:
    """Its points wait until the arm stands: Speed is right for the way from there."""
    harness.stream(client, line(harness, 3, 40.0, 1.0))
    harness.run(0.5)
    begun = len(harness.robot.gone_to)
    client.send(request(STOP), request(point(0, moved(harness.robot.position, j1=-20.0), 1.0)))
    harness.rest()
    assert client.replies() == [(-4, OK), (0, OK)]
    target, speed, *_ = harness.robot.gone_to[begun]
    origin = next(
        where for when, where in harness.robot.path if when >= harness.robot.times[begun]
    )
    wanted = abs(target[0] - origin[0]) / FASTEST[0] / (1.0 - 0.012) * 100.0
    assert abs(speed - wanted) <= 1.0


def test_stop_is_answered_in_every_condition(harness: RobotHarness, client: Client) -> None:
    harness.press_estop()
    assert harness.stream(client, [STOP]) == [(-4, OK)]
    client.send(topic(STOP))
    harness.run(0.1)
    assert client.replies() == []


def test_points_that_are_not_answered_fail_before_the_stop_is_answered() -> None:
    """The look-ahead holds a fast client back; what it has sent by then is answered in order."""
    harness = RobotHarness(LOOK_AHEAD='4')
    client = harness.client()
    client.send(*(request(each) for each in line(harness, 8, 10.0, 1.0)))
    harness.run(0.2)
    assert client.replies() == [(n, OK) for n in range(4)]
    client.send(request(STOP))
    harness.run(0.05)
    assert client.replies() == [*((n, FAILURE) for n in range(4, 8)), (-4, OK)]


def test_a_full_ring_refuses(harness: RobotHarness, client: Client) -> None:
    client.send(*(request(each) for each in line(harness, 260, 0.0, 100.0)))
    harness.run(4.0)
    codes = client.replies()
    assert codes[0] == (0, OK)
    assert (250, FAILURE) in codes
    assert len(codes) == 260
    harness.rest()
    assert harness.stream(client, line(harness, 1)) == [(0, OK)]


def test_a_ring_that_goes_round(harness: RobotHarness, client: Client) -> None:
    for _ in range(9):
        points = line(harness, 30, 1.0, 0.05)
        assert harness.stream(client, points) == [(n, OK) for n in range(30)]
        harness.rest()
        back = [point(0, moved(harness.robot.position, j1=-30.0), 0.5)]
        assert harness.stream(client, back) == [(0, OK)]
        harness.rest()
    assert len(harness.robot.gone_to) == 9 * 31


@pytest.mark.parametrize('kind', [topic, request])
def test_a_download_is_executed_when_it_is_complete(
    harness: RobotHarness, client: Client, kind
) -> None:
    points = line(harness, 5)
    sequences = [-1, 1, 2, 3, -3]
    packets = [
        kind(JointTrajPt(sequence, each.joints, 0.0, 0.2))
        for sequence, each in zip(sequences, points, strict=True)
    ]
    client.send(*packets[:-1])
    harness.run(0.5)
    assert harness.robot.gone_to == []
    client.send(packets[-1])
    harness.rest()
    assert [cp for *_, cp in harness.robot.gone_to] == [True] * 4 + [False]
    expected = [] if kind is topic else [(sequence, OK) for sequence in sequences]
    assert client.replies() == expected


def test_a_download_with_a_bad_point_is_refused_as_a_whole(
    harness: RobotHarness, client: Client
) -> None:
    good, bad = (0.0,) * 10, (math.nan,) * 10
    points = [(-1, good), (1, bad), (2, good), (-3, good)]
    for kind, answers in ((request, [OK, FAILURE, FAILURE, FAILURE]), (topic, [])):
        client.send(*(kind(JointTrajPt(n, joints, 0.1, 0.2)) for n, joints in points))
        harness.run(0.3)
        assert [code for _, code in client.replies()] == answers
    harness.rest()
    assert harness.robot.gone_to == []
    assert harness.stream(client, line(harness, 2)) == [(0, OK), (1, OK)]


def test_a_download_in_the_wrong_order_is_refused(harness: RobotHarness, client: Client) -> None:
    client.send(*(request(JointTrajPt(n, (0.0,) * 10, 0.1, 0.2)) for n in (-1, 2, -3)))
    harness.run(0.3)
    assert client.replies() == [(-1, OK), (2, FAILURE), (-3, FAILURE)]
    client.send(*(request(JointTrajPt(n, (9.0,) * 10, 0.1, 0.2)) for n in (-1, 0)))
    client.send(request(line(harness, 1)[0]))
    harness.run(0.3)
    assert client.replies() == [(-1, FAILURE), (0, FAILURE), (0, OK)]


def test_start_streaming_is_as_sequence_0(harness: RobotHarness, client: Client) -> None:
    first, second = line(harness, 2)
    begin = JointTrajPt(-2, first.joints, 0.0, 0.2)
    assert harness.stream(client, [begin, second]) == [(-2, OK), (1, OK)]


def test_ping_version_and_what_is_unknown(harness: RobotHarness, client: Client) -> None:
    client.send_bytes(struct.pack('<4i', 12, 0, 2, 0))
    unknown = request(Opaque(1599, bytes(8)))
    client.send(request(Ping()), request(Ping((3,) * 10)), request(GetVersion()), unknown)
    client.send(topic(Opaque(1599)), reply(Ping(), ReplyCode.SUCCESS), topic(Ping()))
    harness.run(0.1)
    expected = [
        reply(Ping(), ReplyCode.SUCCESS),
        reply(Ping((0,) * 10), ReplyCode.SUCCESS),
        reply(GetVersion((0, 1, 0)), ReplyCode.SUCCESS),
        reply(Opaque(1599), ReplyCode.FAILURE),
    ]
    assert client.raw() == b''.join(encode(each, LITTLE_ENDIAN) for each in expected)


def test_the_arm_does_not_rest_while_points_are_there(
    harness: RobotHarness, client: Client
) -> None:
    """The next Go comes as soon as the one before is over: no wait of the program in between."""
    harness.stream(client, line(harness, 10))
    harness.rest()
    begun = harness.robot.times
    for (one, (_, speed, *_)), two in zip(
        zip(begun, harness.robot.gone_to, strict=True), begun[1:], strict=False
    ):
        assert two - one < 4.0 / FASTEST[0] / speed * 100.0 + 0.011
    rested = [
        one[1] == two[1]
        for one, two in pairwise(harness.robot.path)
        if begun[0] < one[0] < begun[-1]
    ]
    assert sum(rested) <= len(begun)


def test_the_port_belongs_to_one_client(harness: RobotHarness, client: Client) -> None:
    settings = harness.robot.sockets[MOTION_PORT].settings
    assert (settings.host, settings.tcp_port) == ('192.168.0.2', 11000)
    assert client.open
