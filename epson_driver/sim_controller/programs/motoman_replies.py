# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How MOTION_REPLY messages are made: what they repeat of a message, and what became of it."""

import logging
from typing import Literal

from epson_driver.sim_controller.programs.motoman_points import InvalidReason
from epson_driver.simple_message import (
    ByteOrder,
    Frame,
    JointTrajPtFull,
    MessageType,
    MotionCtrl,
    MotionReply,
    Packet,
)
from epson_driver.simple_message.motoman import Result

_log = logging.getLogger(__name__)


def success(packet: Packet) -> MotionReply:
    """Return SUCCESS with what a reply repeats of a message: group, sequence, command.

    The command of a message that is none is its type; group and sequence are -1 where it has none.
    """
    message = packet.message
    if isinstance(message, MotionCtrl):
        return MotionReply(message.robot_id, message.sequence, message.command, Result.SUCCESS)
    if isinstance(message, JointTrajPtFull):
        return MotionReply(message.robot_id, message.sequence, packet.msg_type, Result.SUCCESS)
    return unreadable(packet.msg_type)


def unreadable(msg_type: int) -> MotionReply:
    """Return SUCCESS for a message of which nothing but the type is known."""
    return MotionReply(-1, -1, msg_type, Result.SUCCESS)


def too_short(frame: Frame) -> MotionReply:
    """Return SUCCESS with what a reply repeats of a frame; what the body lacks counts as 0."""
    if frame.msg_type not in (MessageType.MOTION_CTRL, MessageType.JOINT_TRAJ_PT_FULL):
        return unreadable(frame.msg_type)
    order: Literal['big', 'little'] = 'big' if frame.byte_order is ByteOrder.BIG else 'little'
    words = frame.body[:12].ljust(12, b'\0')
    group, sequence, command = (
        int.from_bytes(words[at : at + 4], order, signed=True) for at in (0, 4, 8)
    )
    if frame.msg_type == MessageType.JOINT_TRAJ_PT_FULL:
        command = frame.msg_type
    return MotionReply(group, sequence, command, Result.SUCCESS)


def outcome(reply: MotionReply, result: Result, subcode: int = 0) -> MotionReply:
    """Return the reply with another result."""
    return MotionReply(reply.robot_id, reply.sequence, reply.command, result, subcode)


def invalid(reply: MotionReply, reason: InvalidReason) -> MotionReply:
    """Return the reply with the result INVALID, and log why."""
    name = reason.subcode.name
    _log.warning('refused (%d, INVALID %s): %s', reason.subcode, name, reason.sentence)
    return outcome(reply, Result.INVALID, reason.subcode)
