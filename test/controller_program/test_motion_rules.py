# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Rules of the motion port that the built-in program and the SPEL+ program share.

`smooth` and `ptp` are the built-in program on the two kinds of arm, and `fanuc` and `abb` its
profiles for other makers. Which rule holds for a kind follows from its profile.
"""

import math
import struct
from typing import NamedTuple

import numpy as np
import pytest
from support.controller_harness import FAILURE, STOP, SUCCESS, frame, point, point_body
from support.examples import one_in
from support.motion_server import LIMITS, PROFILES, motion_server

NAN, INF = math.nan, math.inf
TOPIC, REQUEST, REPLY = 1, 2, 3
FIRST, STREAMING, LAST = -1, -2, -3
PING = 1
CORRUPT, OUT_OF_RANGE, MOTORS_OFF, SILENT = 8000, 4001, 4031, 8004
HOME = (0.0,) * 6
THERE = (0.5, -0.4, 0.3, 0.2, -0.1, 1.0)
FAR = (1.5, -0.4, 0.3, 0.2, -0.1, 1.0)
HEARTBEAT = frame(PING, TOPIC, 0)


def kinds(rule, but=''):
    """Return the decorator that runs a test on each kind whose profile fulfils `rule`."""
    names = [kind for kind, profile in PROFILES.items() if rule(profile) and kind != but]
    return pytest.mark.parametrize('server', names, indirect=True)


EACH = kinds(lambda profile: True)
SEQUENCES = kinds(lambda profile: profile.program.check_sequence)
DOWNLOADS = kinds(lambda profile: profile.program.special_sequences == 'all')
WATCHED = kinds(lambda profile: profile.server.client_timeout)


@pytest.fixture
def server(request):
    return motion_server(request.param)


def slow(sequence, joints, seconds=5.0, comm_type=REQUEST):
    """Return a point that takes the arm some seconds."""
    return point(sequence, joints, 0.05, seconds, comm_type)


def start(server, *first, seconds=10.0):
    """Send `first` and a trajectory of two points, and run until the arm moves."""
    server.send(*first, slow(0, np.array(FAR) / 2, seconds / 2), slow(1, FAR, seconds / 2))
    server.run(0.1)
    assert server.moving
    return server.take()


def assert_at(server, joints):
    assert server.joints == pytest.approx(joints, abs=1e-6)


def assert_works(server):
    """Assert that a new trajectory is executed."""
    server.take()
    target = server.joints + 0.1 * np.array(THERE)
    server.send(point(0, target, 0.0, 0.2))
    assert server.error == 0
    server.run(0.1)
    while server.moving:
        server.run(0.05)
        server.send(HEARTBEAT)
    server.assert_answers((0, SUCCESS))
    assert_at(server, target)


# ---- points


@EACH
def test_point_is_reached_and_answered(server):
    assert_works(server)
    assert not server.moving


@EACH
def test_reply_has_the_expected_bytes(server):
    server.send(point(0))
    assert server.take() == server.reply(0)
    server.send(point(STOP))
    assert server.take() == server.reply(STOP)
    server.send(point(0, (NAN,)))
    assert server.take() == server.reply(0, FAILURE)


@EACH
@pytest.mark.parametrize('chunk', [1, 3, 67])
def test_points_are_answered_whatever_their_segmentation(server, chunk):
    data = point(0) + point(1, THERE, 0.0, 0.5) + point(2)
    server.send(*(data[first : first + chunk] for first in range(0, len(data), chunk)))
    server.rest()
    server.assert_answers((0, SUCCESS), (1, SUCCESS), (2, SUCCESS))


@EACH
def test_pipelined_points_are_answered_in_order(server):
    server.send(b''.join(point(i, (0.04 * i,), 0.0, 0.2) for i in range(12)))
    server.rest()
    server.assert_answers(*((i, SUCCESS) for i in range(12)))
    assert_at(server, (np.float32(0.44), *HOME[1:]))


@DOWNLOADS
def test_start_streaming_is_sequence_0(server):
    server.send(point(STREAMING, THERE, 0.0, 1.0), point(1, HOME, 0.0, 1.0))
    server.rest()
    server.assert_answers((STREAMING, SUCCESS), (1, SUCCESS))


# ---- refused points


class Bad(NamedTuple):
    """A refused frame. `checked`: feature of the profile that makes it invalid."""

    data: bytes
    text: str
    checked: str = ''
    error: int = CORRUPT


CHECKS = {
    '': lambda program: True,
    'velocity': lambda program: program.uses in ('both', 'velocity'),
    'duration': lambda program: program.uses in ('both', 'duration'),
    'sequence': lambda program: program.check_sequence,
    'special': lambda program: program.special_sequences == 'all',
    'limits': lambda program: program.check_limits and not program.late_failure,
    'exact': lambda program: program.accepts == 'exact',
    'header': lambda program: program.accepts != 'any',
    'built-in': lambda program: program.accepts == 'exact',
}

BAD = {
    'joint nan': Bad(point(0, (NAN,)), 'joints[0] = nan is not finite'),
    'joint inf': Bad(point(0, (0, 0, INF)), 'joints[2] = inf is not finite'),
    'unused joint nan': Bad(point(0, (0,) * 9 + (NAN,)), 'joints[9] = nan is not finite'),
    'unused joint inf': Bad(point(0, (0,) * 6 + (-INF,)), 'joints[6] = -inf is not finite'),
    'velocity nan': Bad(point(0, THERE, NAN), 'velocity = nan is not finite', 'velocity'),
    'velocity < 0': Bad(point(0, THERE, -0.1), 'velocity = -0.1 is negative', 'velocity'),
    'velocity > 1': Bad(point(0, THERE, 1.001), 'velocity = 1.001 is above 1', 'velocity'),
    'velocity inf': Bad(point(0, THERE, INF), 'velocity = inf is not finite', 'velocity'),
    'tiny velocity': Bad(point(0, THERE, 1e-30), 'velocity = 1e-30 is below 1e-06', 'built-in'),
    'denormal velocity': Bad(point(0, THERE, 1e-45), 'is below 1e-06', 'built-in'),
    'duration nan': Bad(point(0, THERE, 0.1, NAN), 'duration = nan is not finite', 'duration'),
    'duration < 0': Bad(point(0, THERE, 0.1, -1.0), 'duration = -1 is negative', 'duration'),
    'duration inf': Bad(point(0, THERE, 0.1, INF), 'duration = inf is not finite', 'duration'),
    'long duration': Bad(point(0, THERE, 0.1, 1e5), 'duration = 100000 s is above', 'duration'),
    'above a limit': Bad(
        point(0, (0, 1.2)),
        'joint_2 = 1.2 rad is outside the limits -2.792527 … 1.134464 rad',
        'limits',
        OUT_OF_RANGE,
    ),
    'below a limit': Bad(
        point(0, (-2.98,)),
        'joint_1 = -2.98 rad is outside the limits -2.96706 … 2.96706 rad',
        'limits',
        OUT_OF_RANGE,
    ),
    'far outside': Bad(point(0, (3e38,)), 'joint_1 = 3e+38 rad is outside', 'limits', 4001),
    'wrong sequence': Bad(point(9, THERE), 'out of sequence: it must be', 'sequence'),
    'no download': Bad(point(LAST, THERE), 'no download is active', 'special'),
    'unknown negative': Bad(point(-5, THERE), 'a negative sequence must be -1 to -4', 'special'),
    'most negative': Bad(
        point(-(2**31), THERE), 'a negative sequence must be -1 to -4', 'special'
    ),
    'topic': Bad(point(0, THERE, comm_type=TOPIC), 'must be a request, not a topic', 'header'),
    'STOP as topic': Bad(point(STOP, comm_type=TOPIC), 'must be a request', 'built-in'),
    'reply code': Bad(point(0, THERE, reply_code=1), 'reply_code = 1: must be 0', 'header'),
    'comm type 7': Bad(
        point(0, THERE, comm_type=7),
        'comm_type = 7: must be 1 (topic), 2 (request) or 3 (reply)',
        'header',
    ),
    'comm type 0': Bad(point(0, THERE, comm_type=0), 'comm_type = 0: must be', 'header'),
    'short body': Bad(frame(11, 2, 0, point_body(0, THERE)[:-4]), "body = '48 bytes'", 'header'),
    'long body': Bad(frame(11, 2, 0, point_body(0, THERE) + bytes(4)), "'56 bytes'", 'exact'),
    'no body': Bad(frame(11, 2, 0), "body = '0 bytes'", 'header'),
    'float64 body': Bad(
        frame(11, 2, 0, struct.pack('<i12d', 0, *THERE, 0, 0, 0, 0, 0, 0)),
        'the body must be 52 bytes',
        'exact',
    ),
    'topic without body': Bad(frame(11, TOPIC, 0), "body = '0 bytes'", 'built-in'),
}

REFUSED = [
    (kind, name)
    for kind, profile in PROFILES.items()
    for name, bad in BAD.items()
    if CHECKS[bad.checked](profile.program) and (kind != 'spel' or bad.checked != 'built-in')
]


def refusal(name):
    """Return the expected reply to a bad frame, none for a topic."""
    data = BAD[name].data
    if struct.unpack_from('<i', data, 8)[0] == TOPIC:
        return []
    return [(struct.unpack_from('<i', data, 16)[0] if len(data) == 68 else 0, FAILURE)]


@pytest.mark.invariant(1)
@pytest.mark.parametrize(('server', 'name'), REFUSED, indirect=['server'])
def test_inv1_refused_point_moves_nothing_and_the_next_works(server, name, caplog):
    server.send(BAD[name].data)
    server.assert_answers(*refusal(name))
    server.run(0.1)
    assert not server.moving
    assert server.error == BAD[name].error
    if server.kind != 'spel':
        assert f'refused ({BAD[name].error}): ' in caplog.text
        assert BAD[name].text in caplog.text
    assert_works(server)


@pytest.mark.parametrize(
    ('server', 'name'),
    one_in(4, (case for case in REFUSED if case[0] != 'smooth'), several=True),
    indirect=['server'],
)
def test_refused_point_in_motion_ends_the_motion(server, name):
    taken = start(server)
    server.send(BAD[name].data)
    refused = server.answers()
    assert [code for _, code in refused] == [FAILURE] * len(refused)
    assert server.error == BAD[name].error
    server.rest()
    assert server.joints[0] < 1.0
    replies = taken.count(server.reply(0)[:16]) + len(refused)
    assert replies == 2 + len(refusal(name))
    assert_works(server)


@SEQUENCES
def test_wrong_sequence_is_refused_and_the_next_trajectory_works(server):
    for last in range(3):
        server.send(*(point(i, HOME) for i in range(last + 1)))
        server.assert_answers(*((i, SUCCESS) for i in range(last + 1)))
        for wrong in {last + 2, last, 2**31 - 1, 1000} - {0}:
            server.send(point(wrong, THERE))
            server.assert_answers((wrong, FAILURE))
            assert server.error == CORRUPT
            assert not server.moving
    assert_works(server)


@kinds(lambda profile: CHECKS['limits'](profile.program), but='smooth')
@pytest.mark.invariant(2)
@pytest.mark.parametrize('joint', one_in(2, range(6)))
@pytest.mark.parametrize('limit', [LIMITS.position_min, LIMITS.position_max])
def test_inv2_limit_rounded_to_float32_is_inside_and_beyond_is_not(server, limit, joint):
    outward = np.float32(np.sign(limit[joint]) * np.inf)
    angle = np.float32(limit[joint])
    for value in (angle, np.nextafter(angle, -outward)):
        server.send(point(0, [0.0] * joint + [float(value)], 0.0, 1.5))
        server.rest()
        server.assert_answers((0, SUCCESS))
        position = server.joints[joint]
        slack = server.limit_tolerance
        assert LIMITS.position_min[joint] - slack <= position
        assert position <= LIMITS.position_max[joint] + slack
        assert position == pytest.approx(value, abs=1e-6 + slack)
    angle += np.float32(np.sign(limit[joint]) * server.limit_tolerance)
    server.send(point(1, [0.0] * joint + [float(np.nextafter(angle, outward))]))
    server.rest()
    server.assert_answers((1, FAILURE))
    assert server.error == OUT_OF_RANGE


@EACH
def test_points_are_refused_while_the_motors_are_off(server):
    server.do('motors off')
    server.send(point(0, THERE))
    server.assert_answers((0, FAILURE))
    assert server.error == MOTORS_OFF
    server.do('motors on')
    server.run(0.5)
    assert_at(server, HOME)
    assert_works(server)


@pytest.mark.invariant(7)
@SEQUENCES
def test_inv7_too_many_points_end_the_motion(server):
    number = server.pending_limit + 20
    server.send(*(slow(i, HOME if i % 2 else THERE) for i in range(number)))
    server.run(2.0)
    codes = [code for _, code in server.answers()]
    assert len(codes) == number
    assert sorted(codes) == codes
    assert codes[-1] == FAILURE
    server.rest()
    server.send(point(number, HOME))
    server.assert_answers((number, FAILURE))
    assert_works(server)


# ---- STOP


@pytest.mark.invariant(3)
@EACH
def test_inv3_stop_answers_in_order_and_brakes(server):
    acknowledged = server.reply(0)[:16]
    taken = start(server, seconds=4.0).count(acknowledged)
    server.send(point(STOP, (NAN,), NAN, -INF))  # its other fields do not count
    server.assert_answers(*((i, FAILURE) for i in range(taken, 2)), (STOP, SUCCESS))
    server.run(0.01)
    server.send(point(STOP))
    server.assert_answers((STOP, SUCCESS))
    server.run(0.4)
    assert not server.moving
    stopped = server.joints
    server.run(3.0)
    assert np.array_equal(server.joints, stopped)
    assert server.error == 0
    if server.profile.program.check_sequence:
        server.send(point(2, HOME))
        server.assert_answers((2, FAILURE))
    assert_works(server)


@EACH
def test_trajectory_sent_after_stop_starts_from_rest(server):
    start(server)
    server.send(point(STOP), point(0, HOME, 0.0, 1.0))
    server.rest()
    assert server.answers()[-2:] == server.numbered((STOP, SUCCESS), (0, SUCCESS))
    assert_at(server, HOME)


@EACH
def test_stop_is_answered_in_every_condition(server):
    for event in ('', 'pause', 'continue', 'motors off', 'motors on', 'E-stop press'):
        if event:
            server.do(event)
        server.send(point(STOP))
        server.assert_answers((STOP, SUCCESS))


@kinds(lambda profile: profile.program.accepts == 'longer' or profile.name == 'spel')
@pytest.mark.invariant(3)
def test_inv3_stop_as_a_topic_is_obeyed_without_a_reply(server):
    pending = 2 - start(server).count(server.reply(0)[:16])
    server.send(point(STOP, comm_type=TOPIC))
    assert [code for _, code in server.answers()] == [FAILURE] * pending
    assert server.error == 0
    server.rest()
    assert 0.0 < server.joints[0] < 1.0


# ---- other messages

OTHER = kinds(lambda profile: profile.program.accepts != 'any')


@OTHER
@pytest.mark.parametrize(
    ('sent', 'reply'),
    [
        (frame(1, 2, 0), frame(1, 3, 1)),
        (frame(1, 2, 0, bytes(40)), frame(1, 3, 1, bytes(40))),
        (frame(1, 2, 0, b'\1' * 40), frame(1, 3, 1, bytes(40))),
        (frame(1, 2, 0, b'\1' * 44), frame(1, 3, 1)),
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
    ids=lambda data: data[4:32].hex(),
)
def test_other_message_gets_its_reply_and_the_motion_continues(server, sent, reply):
    start(server)
    server.send(sent)
    assert server.take() == reply
    assert server.error == 0
    assert server.moving


@OTHER
@pytest.mark.parametrize(
    'sent',
    [
        frame(1, 9, 0),
        frame(1, 0, 0),
        frame(1, 2, 1),
        frame(13, 2, 0, bytes(27)),
        frame(1, 2, 0, bytes(5)),
        frame(999, 4, 0),
    ],
    ids=bytes.hex,
)
def test_invalid_header_or_body_gets_failure(server, sent):
    server.send(sent)
    assert server.take() == frame(struct.unpack_from('<i', sent, 4)[0], 3, FAILURE)
    assert_works(server)


@OTHER
@pytest.mark.parametrize('msg_type', [-7, 0, 1, 10, 11, 13, 999])
@pytest.mark.parametrize(
    ('comm_type', 'code', 'size'), [(3, 1, 52), (3, 2, 0), (1, 0, 53)], ids=str
)
def test_replies_and_topics_are_never_answered(server, comm_type, code, size, msg_type):
    """Two peers that answer each other would do so forever."""
    if server.kind == 'spel' and msg_type == 11:
        return  # it answers a JOINT_TRAJ_PT of another size
    server.send(frame(msg_type, comm_type, code, bytes(size)))
    assert server.take() == b''


@OTHER
@pytest.mark.parametrize(('code', 'size'), [(1, 52), (2, 52)])
def test_reply_does_not_disturb_a_motion(server, code, size):
    start(server)
    server.send(frame(11, REPLY, code, bytes(size)))
    assert server.take() == b''
    assert server.moving
    assert server.error == 0


# ---- downloads


def trajectory(number, comm_type=TOPIC, joints=THERE):
    """Return the messages of a download of `number` ≥ 2 points to `joints`."""
    sequences = [FIRST, *range(1, number - 1), LAST]
    return [
        point(sequence, [q * (index + 1) / number for q in joints], 0.0, 0.3, comm_type)
        for index, sequence in enumerate(sequences)
    ]


@DOWNLOADS
@pytest.mark.parametrize('comm_type', [TOPIC, REQUEST])
def test_download_is_executed_when_its_last_point_arrives(server, comm_type):
    *before, last = trajectory(5, comm_type)
    server.send(*before)
    server.run(0.5)
    assert_at(server, HOME)
    server.send(last)
    server.run(0.1)
    assert server.moving
    server.rest()
    assert_at(server, THERE)
    sequences = [FIRST, 1, 2, 3, LAST] if comm_type == REQUEST else []
    server.assert_answers(*((s, SUCCESS) for s in sequences))


@pytest.mark.invariant(1)
@DOWNLOADS
@pytest.mark.parametrize('comm_type', [TOPIC, REQUEST])
@pytest.mark.parametrize('index', one_in(2, [0, 3, 9]))
@pytest.mark.parametrize('bad', ['joint nan', 'above a limit'])
def test_inv1_bad_point_refuses_the_whole_download(server, bad, index, comm_type):
    if bad == 'above a limit' and not server.profile.program.check_limits:
        return  # checked when the arm is to move there
    messages = trajectory(10, comm_type)
    sequences = [FIRST, *range(1, 9), LAST]
    messages[index] = point(
        sequences[index], (1e3,) if bad != 'joint nan' else (NAN,), 0.0, 0.3, comm_type
    )
    server.send(*messages)
    assert server.error == BAD[bad].error
    codes = [code for _, code in server.answers()]
    assert codes == ([] if comm_type == TOPIC else [1] * index + [2] * (10 - index))
    server.run(2.0)
    assert_at(server, HOME)
    server.send(*trajectory(3))
    server.rest()
    assert_at(server, THERE)
    assert server.error == 0


@pytest.mark.invariant(1)
@DOWNLOADS
def test_inv1_new_first_point_replaces_the_download(server):
    server.send(*trajectory(10)[:-1], *trajectory(2, joints=HOME))
    server.rest()
    assert_at(server, HOME)


@pytest.mark.invariant(3)
@DOWNLOADS
@pytest.mark.parametrize('number', range(1, 6))
def test_inv3_stop_ends_a_download_in_every_phase(server, number):
    server.send(*trajectory(5)[:number])
    server.run(0.05)
    server.send(point(STOP))
    server.assert_answers((STOP, SUCCESS))
    server.run(3.0)
    assert server.joints[0] < 0.1
    server.send(*trajectory(5)[number:])  # still in transit when STOP was sent
    server.run(0.5)
    assert server.take() == b''
    assert server.joints[0] < 0.1
    assert_works(server)


@DOWNLOADS
def test_download_is_refused_while_the_motors_are_off(server):
    server.do('motors off')
    server.send(*trajectory(5)[:3])
    assert server.error == MOTORS_OFF
    server.do('motors on')
    server.send(*trajectory(5)[3:])
    server.run(1.0)
    assert_at(server, HOME)
    assert_works(server)


# ---- a silent client


SILENCE = frame(PING, REPLY, FAILURE)
"""The report to a client that was silent while the arm moved."""


@pytest.mark.invariant(3)
@WATCHED
def test_inv3_arm_stops_when_a_client_with_heartbeats_falls_silent(server):
    pending = 2 - start(server, HEARTBEAT).count(server.reply(0)[:16])
    server.run(server.profile.server.client_timeout - 0.2)
    assert server.take() == b''
    assert server.error == 0
    server.run(0.3)
    data = server.take()
    assert data.startswith(SILENCE)
    assert len(data) == len(SILENCE) + pending * 60
    assert server.error == SILENT
    server.run(0.4)
    assert not server.moving
    stopped = server.joints
    server.run(3.0)
    assert np.array_equal(server.joints, stopped)
    assert server.take() == b''  # reported once


@WATCHED
@pytest.mark.parametrize(
    'first', [b'', frame(PING, REQUEST, 0), frame(PING, REPLY, SUCCESS), frame(2, TOPIC, 0)]
)
def test_client_without_heartbeats_may_be_silent(server, first):
    start(server, first, seconds=4.0)
    server.rest()
    assert_at(server, FAR)
    assert server.error == 0


@WATCHED
@pytest.mark.parametrize(
    'message', [HEARTBEAT, frame(PING, REQUEST, 0), frame(2, REQUEST, 0), frame(999, TOPIC, 0)]
)
def test_any_message_counts_as_a_heartbeat(server, message):
    start(server, HEARTBEAT, seconds=4.0)
    while server.moving:
        server.run(0.3)
        server.send(message)
    assert_at(server, FAR)


@pytest.mark.invariant(4)
@WATCHED
def test_inv4_points_after_client_silence_are_refused_until_stop_is_received(server):
    start(server, HEARTBEAT)
    server.run(1.5)
    server.take()
    stopped = server.joints
    server.send(HEARTBEAT, *(point(sequence, FAR) for sequence in (2, 0, FIRST)))
    server.send(point(0, FAR, comm_type=TOPIC))
    server.run(1.0)
    assert [code for _, code in server.answers()] == [FAILURE] * 3
    assert np.array_equal(server.joints, stopped)
    assert server.error == SILENT
    server.send(point(STOP))
    server.assert_answers((STOP, SUCCESS))
    assert_works(server)


@WATCHED
def test_arm_at_rest_needs_no_heartbeats(server):
    server.send(HEARTBEAT, point(0, [0.05] * 6, 0.0, 0.3))
    server.rest()
    server.take()
    server.run(5.0)
    assert server.take() == b''
    assert_works(server)


@pytest.mark.invariant(4)
@WATCHED
def test_inv4_points_of_a_silent_client_are_dropped_during_a_pause(server):
    start(server, HEARTBEAT)
    server.do('pause')
    server.run(2.5)
    assert server.take().startswith(SILENCE)
    stopped = server.joints
    server.do('continue')
    server.run(1.0)
    assert server.joints == pytest.approx(stopped, abs=0.01)


@WATCHED
def test_next_client_may_be_silent(server):
    start(server, HEARTBEAT)
    server.run(1.5)
    server.next_client()
    server.take()
    server.send(slow(0, FAR, 3.0))
    server.rest()
    assert_at(server, FAR)
    assert server.error == 0


@kinds(lambda profile: not profile.server.client_timeout)
def test_profiles_of_other_makers_ignore_silence(server):
    start(server, HEARTBEAT, seconds=4.0)
    server.rest()
    assert_at(server, FAR)
