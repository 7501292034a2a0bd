# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The wire protocol: bytes in, messages out. No sockets, no clock, no ROS.

    framer = Framer()
    framer.receive_data(chunk)
    while (frame := framer.next_frame()) is not None:
        packet = decode(frame)

and back with `encode(request(JointTrajPt(...)), dialect)`.
"""

from epson_driver.simple_message.constants import (
    MAX_JOINTS,
    CommType,
    MessageType,
    Mode,
    ReplyCode,
    SpecialSequence,
    TriState,
    ValidFields,
)
from epson_driver.simple_message.dialect import (
    BIG_ENDIAN,
    LITTLE_ENDIAN,
    ByteOrder,
    Dialect,
    Real,
)
from epson_driver.simple_message.errors import (
    BodyError,
    FieldError,
    FrameError,
    HeaderError,
    SimpleMessageError,
)
from epson_driver.simple_message.framer import Frame, Framer
from epson_driver.simple_message.messages import (
    GetVersion,
    JointFeedback,
    JointPosition,
    JointTraj,
    JointTrajPt,
    JointTrajPtFull,
    Message,
    Opaque,
    Ping,
    Status,
    joint_data,
)
from epson_driver.simple_message.packets import (
    Packet,
    check_header,
    decode,
    encode,
    reply,
    request,
    topic,
)

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
    'JointFeedback',
    'JointPosition',
    'JointTraj',
    'JointTrajPt',
    'JointTrajPtFull',
    'Message',
    'MessageType',
    'Mode',
    'Opaque',
    'Packet',
    'Ping',
    'Real',
    'ReplyCode',
    'SimpleMessageError',
    'SpecialSequence',
    'Status',
    'TriState',
    'ValidFields',
    'check_header',
    'decode',
    'encode',
    'joint_data',
    'reply',
    'request',
    'topic',
]
