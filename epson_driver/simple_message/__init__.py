# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""ROS-Industrial's simple message protocol: bytes to messages and back, without sockets or ROS.

    framer = PacketFramer()
    framer.receive_data(chunk)
    while (packet := framer.next_packet()) is not None:
        ...

`Framer` and `decode` do this in two steps: bytes to frames, then frames to packets.
`encode(request(JointTrajPt(...)), dialect)` returns the bytes of a packet. The modules io_messages
and motoman have further messages.
"""

from epson_driver.simple_message.constants import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    MAX_JOINTS,
    BodyError,
    ByteOrder,
    CommType,
    Dialect,
    FieldError,
    FrameError,
    HeaderError,
    MessageType,
    Mode,
    Real,
    ReplyCode,
    SimpleMessageError,
    SpecialSequence,
    TriState,
    ValidFields,
)
from epson_driver.simple_message.framer import Frame, Framer
from epson_driver.simple_message.io_messages import (
    IoAddress,
    IoRange,
    IoResult,
    IoSetting,
    IoType,
)
from epson_driver.simple_message.layouts import Packet, encode, reply, request, topic
from epson_driver.simple_message.messages import (
    GetVersion,
    JointFeedback,
    JointPosition,
    JointTraj,
    JointTrajPt,
    JointTrajPtFull,
    Message,
    MotionCtrl,
    MotionReply,
    Opaque,
    Ping,
    Status,
    joint_data,
)
from epson_driver.simple_message.packets import PacketFramer, decode

__all__ = [
    'BIG_ENDIAN',
    'LITTLE_ENDIAN',
    'MAX_JOINTS',
    'BodyError',
    'ByteOrder',
    'CommType',
    'Dialect',
    'FieldError',
    'Frame',
    'FrameError',
    'Framer',
    'GetVersion',
    'HeaderError',
    'IoAddress',
    'IoRange',
    'IoResult',
    'IoSetting',
    'IoType',
    'JointFeedback',
    'JointPosition',
    'JointTraj',
    'JointTrajPt',
    'JointTrajPtFull',
    'Message',
    'MessageType',
    'Mode',
    'MotionCtrl',
    'MotionReply',
    'Opaque',
    'Packet',
    'PacketFramer',
    'Ping',
    'Real',
    'ReplyCode',
    'SimpleMessageError',
    'SpecialSequence',
    'Status',
    'TriState',
    'ValidFields',
    'decode',
    'encode',
    'joint_data',
    'reply',
    'request',
    'topic',
]
