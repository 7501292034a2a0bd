# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Whether a reply rejects its request, and the reason as text."""

from epson_driver.driver.delivery.statements import StatementReply
from epson_driver.simple_message import MotionReply, Packet, ReplyCode
from epson_driver.simple_message.motoman import Invalid, NotReady, Result

RESULTS: dict[int, str] = {  # texts for the results of a MOTION_REPLY
    Result.BUSY: 'BUSY: its queue is full',
    Result.FAILURE: 'FAILURE',
    Result.INVALID: 'INVALID: the message is wrong',
    Result.ALARM: 'ALARM: the controller has an alarm',
    Result.NOT_READY: 'NOT_READY: it cannot move now',
    Result.MP_FAILURE: 'MP_FAILURE: a function of the controller failed',
}

SUBCODES: dict[int, str] = {  # texts for MotoROS 1.9
    Invalid.UNSPECIFIED: 'unknown reason',
    Invalid.MSGSIZE: 'the size of the message',
    Invalid.MSGHEADER: 'the header of the message',
    Invalid.MSGTYPE: 'this type of message',
    Invalid.GROUPNO: 'the group of joints',
    Invalid.SEQUENCE: 'the sequence',
    Invalid.COMMAND: 'the command',
    Invalid.DATA: 'the data',
    Invalid.DATA_START_POS: 'the trajectory does not start at the position of the arm',
    Invalid.DATA_POSITION: 'a position',
    Invalid.DATA_SPEED: 'a velocity is above the limit',
    Invalid.DATA_ACCEL: 'an acceleration is above the limit',
    Invalid.DATA_INSUFFICIENT: 'time, position or velocity is missing',
    Invalid.DATA_TIME: 'the time',
    Invalid.DATA_TOOLNO: 'the number of the tool',
    NotReady.UNSPECIFIED: 'unknown reason',
    NotReady.ALARM: 'there is an alarm: reset it',
    NotReady.ERROR: 'there is an error: reset it',
    NotReady.ESTOP: 'the E-stop is pressed',
    NotReady.NOT_PLAY: 'the pendant is not in PLAY mode',
    NotReady.NOT_REMOTE: 'the pendant is not in REMOTE mode',
    NotReady.SERVO_OFF: 'the servos are off',
    NotReady.HOLD: 'the controller is on hold',
    NotReady.NOT_STARTED: 'the job INIT_ROS is not started',
    NotReady.WAITING_ROS: 'it is not in trajectory mode',
    NotReady.SKILLSEND: 'a SKILLSND command failed',
    NotReady.PFL_ACTIVE: 'the power and force limitation is active',
    NotReady.INC_MOVE_ERROR: 'the incremental motion failed',
}


def reply_rejection(packet: Packet) -> str | None:
    """Return why a reply rejects its request, or None if it accepts it.

    Motoman's replies always have SUCCESS in the header, so the result in the body decides.
    """
    message = packet.message
    if isinstance(message, StatementReply):
        return message.why or None
    if packet.reply_code is not ReplyCode.SUCCESS:
        return 'FAILURE reply'
    if not isinstance(message, MotionReply) or message.result == Result.SUCCESS:
        return None
    text = RESULTS.get(message.result, f'result {message.result}')
    if message.subcode:
        text += f', {message.subcode}: {SUBCODES.get(message.subcode, "unknown subcode")}'
    return text
