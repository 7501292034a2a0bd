# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The client's requests and replies of Real-time Motion Control."""

import numpy as np
import pytest

from epson_driver.robots import load_robot_model
from epson_driver.rtmc.messages import (
    MOVED_DATA,
    TARGET_DATA,
    Request,
    RtmcError,
    RtmcMessage,
    RtmcStatus,
    decode,
)
from epson_driver.rtmc.messages import OperationMode as Mode
from epson_driver.rtmc.session import RtmcSession
from simulation.dds_bus import VirtualTransport

MODEL = load_robot_model('t6_602s')


class Sent:
    """A session, its requests and its reports."""

    def __init__(self):
        self.messages = []
        self.notices = []
        self.joints = []
        self.problems = []
        self._pending = []
        self.connected = True
        self.transport = VirtualTransport(self._write)
        self.transport.listen(lambda arrival: self.session.receive(arrival.data, 0.0), None)
        self.session = RtmcSession(
            self.transport,
            MODEL.limits.units,
            self.notices.append,
            lambda joints, _full, _time: self.joints.append(joints),
            self.problems.append,
        )

    def _write(self, data):
        self.messages.append(decode(data))
        return self.connected

    def request(self, number, low=0):
        self._pending.append(self.session.request(RtmcMessage(number, low)))

    @property
    def replies(self):
        return [reply.result() for reply in self._pending if reply.done()]

    def answer(self, number, low=0, high=1, data=b'\0'):
        self.transport.receive(RtmcMessage(number, low, high, data).encode())
        while (arrival := self.transport.take()) is not None:
            self.session.receive(arrival.data, arrival.time)

    def moved(self, *joints):
        self.answer(Request.MOVE, data=MOVED_DATA.pack(0, *joints, 0))

    @property
    def numbers(self):
        return [message.number for message in self.messages]

    @property
    def target(self):
        return self.messages[-1].values(TARGET_DATA)


ZEROS = [0.0] * 6


def started():
    sent = Sent()
    sent.session.start(np.array([0.1, 0.0, -0.02, 0.0]))
    return sent


async def test_one_request_at_a_time_in_order():
    sent = Sent()
    sent.request(Request.RESET)
    sent.request(Request.SET_MOTORS, 1)
    assert sent.numbers == [Request.RESET]
    sent.answer(Request.RESET)
    assert sent.numbers == [Request.RESET, Request.SET_MOTORS]
    sent.answer(Request.SET_MOTORS, 1)
    assert [reply.number for reply in sent.replies] == sent.numbers


async def test_notice_is_no_reply():
    sent = Sent()
    sent.request(Request.RESET)
    status = RtmcStatus(safeguard_open=False, estop=True, mode=Mode.AUTO)
    sent.answer(Request.STATUS_NOTICE, data=status.encode())
    assert RtmcStatus.decode(sent.notices[0]) == status
    assert not sent.replies


@pytest.mark.parametrize(
    ('number', 'data'),
    [(Request.SET_MOTORS, b'\0'), (Request.JOINTS, b'\0'), (Request.MOVE, b'\0')],
)
async def test_other_reply_or_size_is_an_error(number, data):
    sent = Sent()
    sent.request(Request.JOINTS)
    with pytest.raises(RtmcError):
        sent.answer(number, data=data)
    assert not sent.replies


def test_prismatic_joint_has_millimetres_in_messages():
    sent = started()
    target = sent.messages[0].values(TARGET_DATA)
    assert target == pytest.approx((0.1, 0.0, -20.0, 0.0, 0.0, 0.0, 0))
    sent.moved(0.1, 0.0, -20.0, 0.0, 0.0, 0.0)
    assert sent.joints[0] == pytest.approx((0.1, 0.0, -0.02, 0.0))


def test_targets_are_sent_in_order_and_the_last_one_is_repeated():
    sent = started()
    assert sent.session.replace(0, np.arange(12.0).reshape(3, 4), 1)
    firsts = []
    for _ in range(5):
        sent.moved(*ZEROS)
        firsts.append(sent.target[0])
    assert firsts == [0.0, 4.0, 8.0, 8.0, 8.0]
    assert sent.session.taken == 3


@pytest.mark.invariant(3)
def test_inv3_only_targets_that_are_not_taken_are_replaced():
    sent = started()
    replace = sent.session.replace
    assert replace(0, np.full((4, 4), 1.0), 3)
    assert not replace(4, np.full((1, 4), 2.0), 1)  # after a target that brakes
    sent.moved(*ZEROS)
    sent.moved(*ZEROS)
    assert not replace(1, np.full((1, 4), 2.0), 1)
    assert replace(3, np.full((2, 4), 3.0), 1)
    sent.moved(*ZEROS)
    sent.moved(*ZEROS)
    assert sent.target[0] == 3.0
    assert replace(4, np.empty((0, 4)), 0)
    sent.moved(*ZEROS)
    assert (sent.target[0], sent.session.taken) == (3.0, 4)
    assert replace(4, np.full((2, 4), 5.0), 0)
    sent.moved(*ZEROS)
    assert not replace(4, np.full((2, 4), 6.0), 2)  # a target that brakes has been taken
    assert not replace(5, np.full((2, 4), 6.0), 2)


async def test_request_without_a_controller_is_not_sent_later():
    sent = Sent()
    sent.connected = False
    with pytest.raises(ConnectionError, match='has left'):
        sent.request(Request.CONNECT, 1)
    sent.connected = True
    sent.request(Request.STATUS)
    assert sent.numbers == [Request.CONNECT, Request.STATUS]
    with pytest.raises(RtmcError):
        sent.answer(Request.CONNECT)


async def test_waiting_request_precedes_the_next_target():
    sent = started()
    sent.request(Request.SET_MODE, 0)
    sent.moved(*ZEROS)
    assert sent.numbers == [Request.MOVE, Request.SET_MODE]
    sent.session.end()
    sent.answer(Request.SET_MODE)
    assert len(sent.messages) == 2


@pytest.mark.invariant(10)
def test_inv10_replies_of_another_controller_take_no_targets():
    sent = started()
    sent.moved(*ZEROS)
    assert sent.session.replace(0, np.arange(12.0).reshape(3, 4), 3)
    data = RtmcMessage(Request.MOVE, 0, 1, MOVED_DATA.pack(0, *ZEROS, 0)).encode()
    sent.transport.receive(data, sender=5)
    assert sent.session.taken == 0
    sent.moved(*ZEROS)
    assert sent.session.taken == 1


def test_refused_target_ends_the_motion():
    sent = started()
    sent.answer(Request.MOVE, 6, 0)
    assert 'E-stop' in sent.problems[0]
    assert sent.numbers == [Request.MOVE]
