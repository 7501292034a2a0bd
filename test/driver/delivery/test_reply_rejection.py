# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a reply says against its request, in words."""

import pytest

from epson_driver.driver.delivery.reply_rejection import RESULTS, SUBCODES, reply_rejection
from epson_driver.simple_message import JointPosition, MotionReply, Opaque, ReplyCode, reply
from epson_driver.simple_message.motoman import Invalid, NotReady, Result

OK, NO = ReplyCode.SUCCESS, ReplyCode.FAILURE


@pytest.mark.parametrize(
    ('packet', 'text'),
    [
        (reply(JointPosition(), OK), None),
        (reply(Opaque(11), OK), None),
        (reply(MotionReply(0, 3, 14, 0), OK), None),
        (reply(JointPosition(), NO), 'FAILURE reply'),
        (reply(MotionReply(0, 3, 14, 0), NO), 'FAILURE reply'),
        (reply(MotionReply(0, 3, 14, 1), OK), 'BUSY: its queue is full'),
        (
            reply(MotionReply(0, 3, 14, 3, 3011), OK),
            'INVALID: the message is wrong, 3011: the trajectory does not start where the arm '
            'stands',
        ),
        (
            reply(MotionReply(0, 3, 14, 5, 5006), OK),
            'NOT_READY: it cannot move now, 5006: the servos are off',
        ),
        (reply(MotionReply(0, 3, 14, 9, 77), OK), 'result 9, 77: not a known subcode'),
    ],
)
def test_a_reply_in_words(packet, text):
    assert reply_rejection(packet) == text


def test_every_number_has_words():
    assert RESULTS.keys() == set(Result) - {Result.SUCCESS}
    assert SUBCODES.keys() == {*Invalid, *NotReady}
