# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The motion program: points, their replies, and the watchdog of its client."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from support.controller_harness import (
    FAILURE,
    LIMITS,
    PROFILE,
    STOP,
    SUCCESS,
    Harness,
    InlinePlanner,
    Peer,
    Reply,
    frame,
    point,
    point_body,
    split,
)

from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.arm.point_to_point import PointToPoint
from epson_driver.sim_controller.condition.states import Event

HERE = (0.0,) * 6
THERE = (0.5, -0.4, 0.3, 0.2, -0.1, 1.0)
NAN, INF = math.nan, math.inf


def test_a_point_is_answered_when_the_arm_is_there_and_rests():
    harness = Harness()
    harness.send(point(0, THERE))
    assert harness.controller.moving
    assert harness.replies() == []
    assert harness.rest() > 0.1
    assert harness.replies() == [(10, 3, SUCCESS, 0)]
    assert harness.joints.tolist() == np.float32(THERE).tolist()  # exact
    assert harness.error == 0


def test_the_reply_to_a_point_byte_by_byte():
    harness = Harness()
    harness.send(point(0))
    assert bytes(harness.peer.got) == (
        bytes.fromhex('38000000 0a000000 03000000 01000000 00000000') + bytes(40)
    )


def test_a_point_where_the_arm_stands_is_done_at_once():
    harness = Harness(start=THERE)
    harness.send(point(0, THERE))
    assert harness.codes() == [(0, SUCCESS)]
    assert not harness.controller.moving


@pytest.mark.parametrize('chunk', [1, 3, 67])
def test_points_in_any_segmentation(chunk):
    harness = Harness()
    data = point(0) + point(1, THERE) + point(2)
    for start in range(0, len(data), chunk):
        harness.send(data[start : start + chunk])
    harness.rest()
    assert harness.codes() == [(0, SUCCESS), (1, SUCCESS), (2, SUCCESS)]


@pytest.mark.parametrize(
    ('velocity', 'fraction'), [(0.0, 0.5), (0.1, 0.1), (0.5, 0.5), (1.0, 0.5), (0.001, 0.001)]
)
def test_the_arm_is_never_faster_than_speed_percent_nor_than_asked_for(velocity, fraction):
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


# ---- rejections

REFUSED = {
    'joint nan': (point(0, (NAN,)), 8000, 'joints[0] = nan is not finite'),
    'joint inf': (point(0, (0, 0, INF)), 8000, 'joints[2] = inf is not finite'),
    'unused joint nan': (point(0, (0,) * 9 + (NAN,)), 8000, 'joints[9] = nan is not finite'),
    'unused joint inf': (point(0, (0,) * 6 + (-INF,)), 8000, 'joints[6] = -inf is not finite'),
    'velocity nan': (point(0, THERE, NAN), 8000, 'velocity = nan is not finite'),
    'velocity negative': (point(0, THERE, -0.1), 8000, 'velocity = -0.1 is negative'),
    'velocity above 1': (point(0, THERE, 1.001), 8000, 'velocity = 1.001 is above 1'),
    'velocity inf': (point(0, THERE, INF), 8000, 'velocity = inf is not finite'),
    'velocity too small to move': (
        point(0, THERE, 1e-30),
        8000,
        'velocity = 1e-30 is below 1e-06',
    ),
    'velocity denormal': (point(0, THERE, 1e-45), 8000, 'is below 1e-06'),
    'duration nan': (point(0, THERE, 0.1, NAN), 8000, 'duration = nan is not finite'),
    'duration negative': (point(0, THERE, 0.1, -1.0), 8000, 'duration = -1 is negative'),
    'duration inf': (point(0, THERE, 0.1, INF), 8000, 'duration = inf is not finite'),
    'above a limit': (
        point(0, (0, 1.2)),
        4001,
        'joint_2 = 1.2 rad is outside the limits -2.792527 … 1.134464 rad',
    ),
    'below a limit': (
        point(0, (-2.98,)),
        4001,
        'joint_1 = -2.98 rad is outside the limits -2.96706 … 2.96706 rad',
    ),
    'far outside': (point(0, (3e38,)), 4001, 'joint_1 = 3e+38 rad is outside the limits'),
    'begins with 1': (point(1, THERE), 8000, 'out of sequence: it must be 0'),
    'no download ends': (point(-3, THERE), 8000, 'no download is under way'),
    'unknown negative': (point(-5, THERE), 8000, 'the negative sequences are -1 to -4'),
    'most negative': (point(-(2**31), THERE), 8000, 'the negative sequences are -1 to -4'),
    'topic': (point(0, THERE, comm_type=1), 8000, 'must be a request, not a topic'),
    'stop as topic': (point(STOP, comm_type=1), 8000, 'must be a request, not a topic'),
    'request with reply code': (point(0, THERE, reply_code=1), 8000, 'reply_code = 1: must be 0'),
    'unknown comm type': (
        point(0, THERE, comm_type=7),
        8000,
        'comm_type = 7: must be 1 (topic), 2 (request) or 3 (reply)',
    ),
    'no comm type': (point(0, THERE, comm_type=0), 8000, 'comm_type = 0: must be'),
    'body too short': (frame(11, 2, 0, point_body(0, THERE)[:-4]), 8000, "body = '48 bytes'"),
    'body too long': (frame(11, 2, 0, point_body(0, THERE) + bytes(4)), 8000, "body = '56 bytes'"),
    'no body': (frame(11, 2, 0), 8000, "body = '0 bytes'"),
    'float64 body': (
        frame(11, 2, 0, struct.pack('<i12d', 0, *THERE, 0, 0, 0, 0, 0, 0)),
        8000,
        'the body must be 52 bytes',
    ),
    'topic without body': (frame(11, 1, 0), 8000, "body = '0 bytes'"),
}
UNANSWERED = ('topic', 'stop as topic', 'topic without body')
"""They end a motion, but get no reply."""


@pytest.mark.invariant(1)
@pytest.mark.parametrize('name', REFUSED)
def test_invariant_1_a_refused_point_moves_nothing_and_the_next_good_one_works(name, caplog):
    bad, error, words = REFUSED[name]
    sequence = struct.unpack_from('<i', bad, 16)[0] if len(bad) == 68 else 0
    harness = Harness()
    harness.send(bad)
    answered = [] if name in UNANSWERED else [(10, 3, FAILURE, sequence)]
    assert harness.replies() == answered
    assert not harness.controller.moving
    assert f'refused ({error}): ' in caplog.text
    assert words in caplog.text
    status = harness.controller.status()
    assert (status.error_code, status.in_error, status.motion_possible) == (error, 1, 0)
    harness.send(point(0, THERE))
    assert harness.error == 0
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]
    assert harness.controller.status().motion_possible == 1


@pytest.mark.parametrize('name', REFUSED)
def test_a_refused_point_in_mid_move_ends_the_motion_with_replies_in_order(name):
    bad, error, _ = REFUSED[name]
    harness = Harness()
    harness.send(point(0), point(1, THERE), point(2, HERE))
    harness.step(0.1)
    harness.codes()
    if name == 'begins with 1':
        bad = point(9, THERE)
    harness.send(bad)
    codes = harness.codes()
    assert codes[:2] == [(1, FAILURE), (2, FAILURE)]
    assert [code for _, code in codes[2:]] == [FAILURE] * (name not in UNANSWERED)
    assert harness.error == error
    harness.rest()
    stopped = harness.joints
    assert 0.0 < stopped[0] < 0.5
    harness.step(0.5)
    assert harness.joints.tolist() == stopped.tolist()
    harness.send(point(1, THERE))  # the interrupted point again
    harness.rest()
    assert harness.codes() == [(1, SUCCESS)]


def test_wrong_sequences_and_the_correct_one_after_each():
    harness = Harness()
    for good in range(4):
        harness.send(point(good, HERE))
        assert harness.codes() == [(good, SUCCESS)]
        for wrong in {good + 2, good - 1, good, 2**31 - 1, 1000} - {0, good + 1, -1}:
            harness.send(point(wrong, THERE))
            assert harness.codes() == [(wrong, FAILURE)]
            assert harness.error == 8000
            assert not harness.controller.moving
    harness.send(point(4, THERE))
    harness.rest()
    harness.send(point(0, HERE))  # a new trajectory at any time
    harness.rest()
    assert harness.codes() == [(4, SUCCESS), (0, SUCCESS)]
    assert harness.error == 0


def test_no_point_is_skipped_after_an_abort():
    harness = Harness()
    harness.send(*(point(i, HERE if i % 2 else THERE) for i in range(5)))
    harness.step(0.1)
    harness.send(frame(11, 2, 0))
    harness.codes()
    harness.rest()
    for skipped in (5, 4, 3, 2, 1):  # 0 was not reached
        harness.send(point(skipped, HERE))
        assert harness.codes() == [(skipped, FAILURE)]


# ---- limits


@pytest.mark.invariant(2)
@pytest.mark.parametrize('joint', range(6))
@pytest.mark.parametrize('limit', [LIMITS.position_min, LIMITS.position_max])
def test_invariant_2_a_limit_rounded_to_float32_is_inside_and_one_step_more_is_not(joint, limit):
    outward = np.float32(np.sign(limit[joint]) * np.inf)
    angle = np.float32(limit[joint])
    harness = Harness()
    for sequence, value in enumerate([angle, np.nextafter(angle, -outward)]):
        harness.send(point(sequence, [0.0] * joint + [float(value)]))
        harness.rest()
        assert harness.codes() == [(sequence, SUCCESS)]
        position = harness.joints[joint]
        assert LIMITS.position_min[joint] <= position <= LIMITS.position_max[joint]
        assert np.float32(position) == value
    harness.send(point(2, [0.0] * joint + [float(np.nextafter(angle, outward))]))
    harness.rest()
    # one float32 further is outside, unless the rounding went inward and it is the limit's own
    assert harness.codes() == [(2, FAILURE)]
    assert harness.error == 4001


@pytest.mark.invariant(2)
def test_invariant_2_rounding_on_the_way_to_a_limit_does_not_pass_it():
    random = np.random.default_rng(0)
    for _ in range(300):
        start, target = random.uniform(LIMITS.position_min, LIMITS.position_max, (2, 6))
        joint = random.integers(6)
        target[joint] = LIMITS.position_max[joint]
        arm = PointToPoint(LIMITS, start, 0.5, 0.5)
        arm.take(Point(0, target, 0.0, 0.0))
        left = PointToPoint(LIMITS, start, 0.5, 0.5)
        left.take(Point(0, target, 0.0, 0.0))
        duration = 1000.0 - left.step(1000.0)
        arm.step(duration * (1.0 - 1e-7))
        assert arm.moving
        assert arm.position[joint] <= LIMITS.position_max[joint]


# ---- motors and E-stop


def test_error_4031_with_the_motors_off_and_motors_on_clears_it():
    harness = Harness(motors=False)
    harness.send(point(0, THERE))
    assert harness.codes() == [(0, FAILURE)]
    assert harness.error == 4031
    assert not harness.controller.moving
    harness.do('motors on')
    assert harness.error == 0
    harness.send(point(0, THERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


def test_reset_clears_an_error_and_leaves_the_motors_alone():
    harness = Harness()
    harness.send(point(0, (9.0,)))
    assert harness.error == 4001
    harness.do('motors on')
    assert harness.error == 4001  # motors on clears 4031 only
    harness.do('reset')
    assert harness.error == 0
    assert harness.controller.status().drives_powered == 1


# ---- STOP


@pytest.mark.invariant(3)
def test_invariant_3_stop_in_mid_move_answers_in_order_and_brakes():
    harness = Harness()
    harness.send(point(0, THERE), point(1, HERE), point(2, THERE))
    harness.step(0.1)
    harness.send(point(STOP, (NAN,), NAN, -INF))  # whatever else it holds
    assert harness.codes() == [(0, FAILURE), (1, FAILURE), (2, FAILURE), (STOP, SUCCESS)]
    assert harness.controller.status().in_motion == 1
    assert harness.rest() < 0.2
    status = harness.controller.status()
    assert (status.in_motion, status.error_code, status.drives_powered) == (0, 0, 1)
    harness.send(point(1, HERE))  # the trajectory is over
    assert harness.codes() == [(1, FAILURE)]
    harness.send(point(0, HERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


def test_a_stop_ends_the_trajectory_also_after_points_that_were_reached():
    harness = Harness()
    harness.send(point(0), point(1))
    harness.send(point(2, THERE))
    harness.step(0.1)
    harness.send(point(STOP))
    harness.rest()
    harness.codes()
    for old in (1, 2, 3):
        harness.send(point(old))
        assert harness.codes() == [(old, FAILURE)]


def test_a_second_stop_changes_nothing():
    ends = []
    for stops in (1, 2):
        harness = Harness()
        harness.send(point(0, THERE))
        harness.step(0.1)
        for _ in range(stops):
            harness.send(point(STOP))
            harness.step(0.02)
        time = harness.rest(0.001) + 0.02 * stops
        ends.append((harness.joints.tolist(), pytest.approx(time, abs=0.002)))
    assert ends[0] == ends[1]


def test_a_point_that_arrives_while_a_stop_brakes_waits_for_the_standstill():
    harness = Harness()
    harness.send(point(0, THERE))
    harness.step(0.1)
    harness.send(point(STOP), point(0, HERE))
    assert harness.codes() == [(0, FAILURE), (STOP, SUCCESS)]
    harness.send(point(STOP))
    assert harness.codes() == [(0, FAILURE), (STOP, SUCCESS)]
    harness.send(point(0, HERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]
    assert harness.joints.tolist() == list(HERE)


def test_stop_works_in_every_condition():
    harness = Harness(motors=False)
    events = ('motors on', 'motors off', 'E-stop press', 'E-stop release', 'reset')
    for event in ('', *events):
        if event:
            harness.do(event)
        harness.send(point(STOP))
        assert harness.codes() == [(STOP, SUCCESS)]


# ---- waiting points


def test_pipelined_points_are_all_visited_and_answered_in_order():
    harness = Harness()
    angles = np.float32(np.linspace(0.0, 0.4, 12))
    harness.send(b''.join(point(i, (float(angle),)) for i, angle in enumerate(angles)))
    seen = []
    while harness.controller.moving:
        harness.controller.step(0.001)
        seen += [(sequence, harness.joints[0]) for sequence, _ in harness.codes()]
    assert [sequence for sequence, _ in harness.codes()] == []
    assert [sequence for sequence, _ in seen] == list(range(12))
    for sequence, joint_1 in seen:  # within what the arm does in the rest of the same step
        assert joint_1 == pytest.approx(angles[sequence], abs=2e-3)


@pytest.mark.invariant(7)
def test_invariant_7_too_many_points_end_the_motion():
    motion = replace(PROFILE.motion, pending_limit=5)
    harness = Harness(profile=replace(PROFILE, motion=motion))
    harness.send(*(point(i, THERE if i % 2 == 0 else HERE) for i in range(7)))
    assert harness.codes() == [(i, FAILURE) for i in range(7)]
    assert harness.error == 8000
    harness.rest()
    harness.send(point(7, HERE))  # sent before its client knew
    assert harness.codes() == [(7, FAILURE)]
    harness.send(point(0, HERE))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]


# ---- other messages


@pytest.mark.parametrize(
    ('sent', 'reply'),
    [
        (frame(1, 2, 0), frame(1, 3, 1)),
        (frame(1, 2, 0, bytes(40)), frame(1, 3, 1, bytes(40))),
        (frame(1, 2, 0, b'\1' * 40), frame(1, 3, 1, bytes(40))),
        (frame(2, 2, 0), frame(2, 3, 1, struct.pack('<3i', 0, 2, 0))),
        (frame(13, 2, 0, bytes(28)), frame(13, 3, 2)),
        (frame(10, 2, 0, bytes(44)), frame(10, 3, 2)),
        (frame(14, 2, 0, bytes(136)), frame(14, 3, 2)),
        (frame(2001, 2, 0, bytes(52)), frame(2001, 3, 2)),
        (frame(65000, 2, 0), frame(65000, 3, 2)),
        (frame(13, 1, 0, bytes(28)), b''),
        (frame(10, 1, 0, bytes(44)), b''),
        (frame(1, 1, 0), b''),
        (frame(999, 1, 0, b'abc'), b''),
        (frame(10, 3, 1, bytes(44)), b''),
        (frame(999, 3, 2), b''),
    ],
)
def test_messages_that_are_no_points(sent, reply):
    harness = Harness()
    harness.send(point(0), sent)
    assert bytes(harness.peer.got[60:]) == reply
    assert harness.error == 0
    harness.send(point(1, THERE), sent)
    assert harness.controller.moving  # they do not disturb a move


@pytest.mark.parametrize(
    ('sent', 'reply'),
    [
        (frame(0, 2, 0), (10, 3, FAILURE)),
        (frame(0, 0, 0, bytes(52)), (10, 3, FAILURE)),
        (frame(-7, 2, 0), (10, 3, FAILURE)),
        (frame(1, 9, 0), (1, 3, FAILURE)),
        (frame(1, 0, 0), (1, 3, FAILURE)),
        (frame(1, 2, 1), (1, 3, FAILURE)),
        (frame(13, 2, 0, bytes(27)), (13, 3, FAILURE)),
        (frame(1, 2, 0, bytes(5)), (1, 3, FAILURE)),
        (frame(999, 4, 0), (999, 3, FAILURE)),
    ],
)
def test_headers_and_bodies_against_the_rules_are_answered_with_failure(sent, reply):
    harness = Harness()
    harness.send(sent)
    assert [answer[:3] for answer in harness.replies()] == [reply]
    assert harness.error == 8000
    harness.send(point(0))
    assert harness.codes() == [(0, SUCCESS)]
    assert harness.error == 0


@pytest.mark.parametrize('msg_type', [-7, 0, 1, 10, 11, 13, 999])
@pytest.mark.parametrize(
    ('comm_type', 'reply_code', 'size'),
    [(3, 1, 52), (3, 2, 0), (3, 0, 52), (1, 0, 53), (1, 7, 52)],
)
def test_two_peers_never_answer_each_other_for_ever(msg_type, comm_type, reply_code, size):
    harness = Harness()
    harness.send(frame(msg_type, comm_type, reply_code, bytes(size)))
    assert harness.replies() == []
    state = Peer()
    harness.controller.connect('state', state).receive(
        frame(msg_type, comm_type, reply_code, bytes(size))
    )
    assert state.take() == b''


@pytest.mark.parametrize(('code', 'size'), [(0, 52), (1, 52), (2, 0), (9, 52)])
def test_a_reply_does_not_disturb_a_motion(code, size):
    harness = Harness()
    harness.send(point(0, THERE))
    harness.step(0.1)
    harness.send(frame(11, 3, code, bytes(size)))
    harness.rest()
    assert harness.codes() == [(0, SUCCESS)]
    assert harness.error == 0


def test_big_endian_points_to_a_big_endian_controller():
    from epson_driver.robots import load_robot_model
    from epson_driver.sim_controller.assembly import new_controller
    from epson_driver.simple_message import BIG_ENDIAN

    controller = new_controller(load_robot_model('c3_a601s'), PROFILE, dialect=BIG_ENDIAN)
    peer = Peer()
    connection = controller.connect('motion', peer)
    controller.apply(Event.MOTORS_ON)
    connection.receive(point(0, order='>'))
    ((msg_type, comm_type, reply_code, body),) = split(peer.take(), '>')
    assert (msg_type, comm_type, reply_code, body) == (10, 3, SUCCESS, bytes(44))


TIMEOUT = PROFILE.server.client_timeout

SLICE = TIMEOUT / 20

PING, REQUEST, TOPIC, REPLY = 1, 2, 1, 3

HEARTBEAT = frame(PING, TOPIC, 0)

TOLD = Reply(PING, REPLY, FAILURE, None)

FAR = (1.5, -0.4, 0.3, 0.2, -0.1, 1.0)

SILENT = 8004


def moving(*first, smooth=True, profile=PROFILE, seconds=10.0):
    """Return a controller whose arm is on a way of some seconds, after these messages."""
    harness = Harness(planner=InlinePlanner() if smooth else None, profile=profile)
    halfway, velocity = np.array(FAR) / 2, 0.0 if smooth else 0.05
    points = [point(count, to, velocity, seconds / 2) for count, to in enumerate((halfway, FAR))]
    harness.send(*first, *points)
    harness.step(0.1)
    assert harness.controller.in_motion
    harness.replies()
    return harness


@pytest.mark.invariant(3)
@pytest.mark.parametrize('smooth', [True, False])
def test_an_armed_controller_stops_when_its_client_is_silent(smooth):
    harness = moving(HEARTBEAT, smooth=smooth)
    harness.step(TIMEOUT - 0.1 - 0.008)
    assert harness.replies() == []
    assert harness.error == 0
    harness.step(SLICE + 0.016)
    told, *refused = harness.replies()
    assert told == TOLD
    assert refused == [(10, REPLY, FAILURE, number) for number in ([1] if smooth else [0, 1])]
    assert harness.rest() < 0.3
    assert harness.error == SILENT
    assert harness.controller.condition.powered
    at = harness.joints
    harness.step(2.0)
    assert harness.replies() == []  # once
    assert np.array_equal(harness.joints, at)


@pytest.mark.parametrize('smooth', [True, False])
@pytest.mark.parametrize(
    'first',
    [
        (),
        (frame(PING, REQUEST, 0),),
        (frame(PING, REPLY, SUCCESS),),
        (frame(2, TOPIC, 0), frame(13, TOPIC, 0)),
    ],
)
def test_a_client_that_has_sent_no_heartbeat_may_be_silent(first, smooth):
    harness = moving(*first, smooth=smooth, seconds=4.0)
    harness.rest()
    assert harness.joints == pytest.approx(FAR, abs=1e-6)
    assert harness.error == 0


@pytest.mark.parametrize(
    'message', [HEARTBEAT, frame(PING, REQUEST, 0), frame(2, REQUEST, 0), frame(999, TOPIC, 0)]
)
def test_any_message_is_a_sign_of_life(message):
    harness = moving(HEARTBEAT, seconds=4.0)
    while harness.controller.in_motion:
        harness.step(0.3)
        harness.send(message)
    assert harness.joints == pytest.approx(FAR, abs=1e-6)


@pytest.mark.invariant(4)
def test_nothing_is_taken_from_a_client_that_hung_until_it_sends_stop():
    harness = moving(HEARTBEAT)
    harness.step(1.5)
    harness.replies()
    at = harness.joints
    harness.send(HEARTBEAT, *(point(number, FAR) for number in (2, 0, -1)))
    harness.send(point(0, FAR, comm_type=TOPIC))
    harness.step(1.0)
    assert [reply.reply_code for reply in harness.replies()] == [FAILURE] * 3
    assert np.array_equal(harness.joints, at)
    assert harness.error == SILENT
    harness.send(point(STOP))
    assert harness.codes() == [(STOP, SUCCESS)]
    assert harness.error == 0
    harness.send(HEARTBEAT, point(0, FAR, 0.0, 0.4))
    harness.rest()
    assert harness.joints == pytest.approx(FAR, abs=1e-6)


def test_an_arm_that_stands_is_left_alone():
    harness = Harness(planner=InlinePlanner())
    harness.send(HEARTBEAT, point(0, [0.05] * 6, 0.0, 0.3))
    assert harness.rest() < 0.4
    harness.replies()
    harness.step(5.0)
    assert harness.replies() == []
    assert harness.error == 0
    harness.send(point(0, [0.0] * 6, 0.0, 0.4))
    harness.rest()
    assert harness.error == 0


@pytest.mark.invariant(4)
def test_points_that_wait_in_a_pause_are_dropped():
    harness = moving(HEARTBEAT)
    harness.do('pause')
    harness.rest()
    harness.step(1.0)
    assert harness.replies()[0] == TOLD
    at = harness.joints
    harness.do('continue')
    harness.step(1.0)
    assert np.array_equal(harness.joints, at)


def test_a_download_that_is_cut_short_is_dropped():
    harness = Harness(planner=InlinePlanner())
    harness.send(HEARTBEAT, *(point(number, FAR, comm_type=TOPIC) for number in (-1, 1, 2)))
    harness.step(1.5)
    assert harness.replies() == [TOLD]
    harness.send(point(-3, FAR, comm_type=TOPIC))
    harness.step(1.0)
    assert not harness.controller.in_motion
    assert harness.error == SILENT


def test_a_controller_that_was_not_scheduled_blames_nobody():
    """What came meanwhile is read afterwards; the pacer takes the time as one step."""
    harness = moving(HEARTBEAT, seconds=20.0)
    for _ in range(5):
        harness.step(3.0, dt=3.0)
        harness.send(HEARTBEAT)
    assert harness.replies() == [(10, REPLY, SUCCESS, 1)]
    assert harness.controller.in_motion


def test_the_next_client_may_be_silent_again():
    harness = moving(HEARTBEAT)
    harness.step(1.5)
    harness.disconnect()
    harness.connect()
    harness.do('motors on')
    harness.replies()
    assert harness.error == 0
    harness.send(point(0, FAR, 0.0, 3.0))
    harness.rest()
    assert harness.joints == pytest.approx(FAR, abs=1e-6)


@pytest.mark.parametrize('name', ['generic', 'fanuc', 'abb'])
def test_programs_of_others_have_no_watchdog(name):
    profile = load_controller_profile(name)
    harness = Harness(profile=profile)
    order = '>' if name == 'fanuc' else '<'
    harness.send(frame(PING, TOPIC, 0, order=order))
    assert harness.controller.clock.timers == 0
    assert harness.peer.take() == b''
