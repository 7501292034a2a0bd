# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The request that a reply answers, for every known form of reply."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from epson_driver.link.replies import PendingReplies, PendingRequest
from epson_driver.simple_message import (
    Frame,
    GetVersion,
    JointPosition,
    JointTrajPt,
    JointTrajPtFull,
    MotionCtrl,
    MotionReply,
    Opaque,
    Ping,
    ReplyCode,
    SpecialSequence,
    decode,
    reply,
    request,
)

STOP = SpecialSequence.STOP_TRAJECTORY
OK, NO = ReplyCode.SUCCESS, ReplyCode.FAILURE


def epson(code=OK):
    """EPSON's program: JOINT_POSITION, all zero."""
    return reply(JointPosition(), code)


def fanuc(sequence, code=OK):
    """FANUC: JOINT_POSITION with the request's sequence."""
    return reply(JointPosition(sequence), code)


def abb(code=OK, msg_type=11):
    """ABB: a header of the request's type without a body, as decoded from the wire."""
    return decode(Frame(msg_type, 3, code, b'', request(Ping()).dialect.byte_order))


def motoman(sequence, code=OK):
    """A whole point as the reply."""
    return reply(JointTrajPt(sequence), code)


def garbage(msg_type=10):
    """A FAILURE with a meaningless body (REP-I0006)."""
    order = request(Ping()).dialect.byte_order
    return decode(Frame(msg_type, 3, NO, b'\xde\xad\xbe\xef\x01', order))


def waiting_for(message, sent=0.0):
    return PendingRequest(message, sent, lambda *_: None)


def answered(*steps):
    """Post messages and take replies; return the request that each reply answered.

    A request is named by its sequence, or by its type if it has none. None means no request.
    """
    pending = PendingReplies()
    names = []
    for step in steps:
        if hasattr(step, 'comm_type'):
            request = pending.take(step)
            names.append(None if request is None else name_of(request))
        else:
            pending.add(waiting_for(step))
    return names


def name_of(waiting):
    return waiting.sequence if waiting.sequence is not None else f'type {waiting.msg_type}'


POINT = [JointTrajPt(sequence) for sequence in range(8)]
STOPPING = JointTrajPt(STOP)


@pytest.mark.parametrize(
    ('steps', 'expected'),
    [
        pytest.param([POINT[0], epson(), POINT[1], epson()], [0, 1], id='EPSON'),
        pytest.param([POINT[3], epson(NO)], [3], id='EPSON refuses'),
        pytest.param([POINT[0], fanuc(0), POINT[1], fanuc(1)], [0, 1], id='FANUC'),
        pytest.param([POINT[1], POINT[2], fanuc(2), fanuc(1)], [2, 1], id='FANUC out of order'),
        pytest.param([POINT[0], abb(), POINT[1], abb()], [0, 1], id='ABB'),
        pytest.param([POINT[0], abb(NO)], [0], id='ABB refuses'),
        pytest.param([POINT[5], motoman(5)], [5], id='the point itself'),
        pytest.param([POINT[2], garbage()], [2], id='FAILURE, garbage in JOINT_POSITION'),
        pytest.param([POINT[2], garbage(11)], [2], id='FAILURE, garbage in JOINT_TRAJ_PT'),
        pytest.param(
            [POINT[1], fanuc(1), POINT[2], fanuc(1, NO), fanuc(2)],
            [1, None, 2],
            id="FANUC takes an acknowledgement back: the next point's reply is another",
        ),
        pytest.param([fanuc(1, NO)], [None], id='nobody waits'),
        pytest.param([POINT[1], epson(), epson()], [1, None], id='one reply too many'),
        pytest.param([POINT[2], STOPPING, fanuc(2, NO), fanuc(STOP)], [2, STOP], id='STOP last'),
        pytest.param(
            [POINT[2], STOPPING, fanuc(STOP), fanuc(2, NO)], [STOP, 2], id='STOP overtakes'
        ),
        pytest.param([POINT[2], STOPPING, epson(NO), epson()], [2, STOP], id='STOP, EPSON'),
        pytest.param([POINT[2], STOPPING, abb(NO), abb()], [2, STOP], id='STOP, ABB'),
        pytest.param(
            [POINT[1], fanuc(1), POINT[2], fanuc(2), POINT[0], fanuc(0), POINT[1], fanuc(1)],
            [1, 2, 0, 1],
            id='a new trajectory counts from 0 again',
        ),
        pytest.param(
            [POINT[1], fanuc(1), POINT[1], epson()], [1, 1], id='the same sequence, other form'
        ),
        pytest.param([POINT[3], fanuc(77)], [3], id='a sequence of its own: the oldest'),
        pytest.param([POINT[4], STOPPING, abb(), fanuc(STOP)], [4, STOP], id='forms mixed'),
        pytest.param([STOPPING, epson(), POINT[0], epson()], [STOP, 0], id='STOP alone'),
        pytest.param([Ping(), abb(OK, 1)], ['type 1'], id='PING of the library'),
        pytest.param([Ping(), reply(Ping((0,) * 10), OK)], ['type 1'], id='PING of the REP'),
        pytest.param([GetVersion(), reply(GetVersion((1, 2, 3)), OK)], ['type 2'], id='version'),
        pytest.param([GetVersion(), abb(NO, 2)], ['type 2'], id='no version'),
        pytest.param(
            [POINT[1], Ping(), GetVersion(), abb(OK, 1), abb(NO, 2), epson()],
            ['type 1', 'type 2', 1],
            id='other types do not answer a point',
        ),
        pytest.param([Ping(), epson()], [None], id='a joint position does not answer a PING'),
        pytest.param([POINT[0], abb(OK, 1)], [None], id='a PING reply does not answer a point'),
        pytest.param([Opaque(1500), reply(Opaque(1500), OK)], ['type 1500'], id='vendor type'),
        pytest.param(
            [JointTrajPtFull(0, 3, 0), fanuc(3), JointTrajPtFull(0, 4, 0), abb(OK, 14)],
            [3, 4],
            id='full points',
        ),
    ],
)
def test_reply_of_each_controller_answers_its_request(steps, expected):
    assert answered(*steps) == expected


def test_replies_after_a_lost_link_answer_no_old_request():
    pending = PendingReplies()
    pending.add(waiting_for(POINT[1]))
    pending.take(fanuc(1))
    pending.add(waiting_for(POINT[2]))
    pending.clear()
    assert len(pending) == 0
    assert pending.take(fanuc(2)) is None
    pending.add(waiting_for(POINT[5]))  # earlier answers are forgotten too
    assert pending.take(fanuc(1)).sequence == 5


@pytest.mark.parametrize('form', [epson(), fanuc(0), abb()], ids=['EPSON', 'FANUC', 'ABB'])
def test_missing_reply_does_not_shift_the_next_trajectory(form):
    pending = PendingReplies()
    pending.add(waiting_for(POINT[3], sent=10.0))  # its reply is lost, and the goal ends
    pending.add(waiting_for(STOPPING, sent=15.0))
    pending.take(fanuc(STOP))
    following = waiting_for(POINT[0], sent=17.0)
    pending.add(following)
    assert pending.take(form) is following
    assert len(pending) == 0


def test_pending_replies_precede_new_ones():
    pending = PendingReplies()
    stop = waiting_for(STOPPING, sent=10.0)
    following = waiting_for(POINT[0], sent=10.02)
    pending.add(stop)
    pending.add(following)
    assert pending.take(epson()) is stop
    assert pending.take(epson()) is following


def test_number_of_pending_requests_is_bounded():
    pending = PendingReplies()
    for count in range(10_000):
        pending.add(waiting_for(STOPPING, sent=count * 0.01))
    newest = waiting_for(JointTrajPt(7), sent=100.0)
    pending.add(newest)
    assert len(pending) <= 100
    assert pending.take(fanuc(7)) is newest


MESSAGES = st.one_of(
    st.integers(-5, 40).map(JointTrajPt),
    st.integers(-5, 40).map(lambda sequence: JointTrajPtFull(0, sequence, 0)),
    st.just(Ping()),
    st.just(GetVersion()),
    st.integers(100, 103).map(Opaque),
)
REPLIES = st.builds(
    reply,
    st.one_of(
        st.integers(-(2**31), 2**31 - 1).map(JointPosition),
        MESSAGES,
        st.sampled_from((1, 2, 10, 11, 13, 14, 99)).map(Opaque),
    ),
    st.sampled_from((OK, NO)),
)


@given(st.lists(st.one_of(MESSAGES, REPLIES), max_size=120))
def test_no_request_is_answered_twice(steps):
    pending = PendingReplies()
    posted, taken = [], []
    for time, step in enumerate(steps):
        if hasattr(step, 'comm_type'):
            before = len(pending)
            answered_request = pending.take(step)
            if answered_request is not None:
                taken.append(id(answered_request))
            assert len(pending) == before - (answered_request is not None)
        else:
            posted.append(waiting_for(step, sent=time * 0.1))
            pending.add(posted[-1])
    assert len(taken) == len(set(taken))
    assert set(taken) <= {id(waiting) for waiting in posted}
    assert len(pending) <= len(posted) - len(taken)


def test_motion_reply_answers_the_command_it_repeats():
    """A STOP_MOTION overtakes a point at a Motoman, and each gets a MOTION_REPLY."""
    point, stop = JointTrajPtFull(0, 5, 7), MotionCtrl(0, 0, 200111)
    pending = PendingReplies()
    for message in (point, stop):
        pending.add(waiting_for(message))
    stopped = pending.take(reply(MotionReply(0, 0, 200111, 0), OK))
    assert stopped is not None
    assert stopped.message == stop
    assert pending.take(reply(MotionReply(0, 0, 200121, 0), OK)) is None
    answered_point = pending.take(reply(MotionReply(0, 5, 14, 0), OK))
    assert answered_point is not None
    assert answered_point.sequence == 5
    assert len(pending) == 0
