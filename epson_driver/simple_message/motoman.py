# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers of Motoman's own messages, as MotoROS 1.9 has them (MOTION_CTRL, MOTION_REPLY)."""

from enum import IntEnum


class Command(IntEnum):
    """Values of `MotionCtrl.command`."""

    CHECK_MOTION_READY = 200101
    CHECK_QUEUE_CNT = 200102
    STOP_MOTION = 200111
    START_SERVOS = 200112
    STOP_SERVOS = 200113
    RESET_ALARM = 200114
    START_TRAJ_MODE = 200121
    STOP_TRAJ_MODE = 200122
    DISCONNECT = 200130


class Result(IntEnum):
    """Values of `MotionReply.result`. SUCCESS also means true, FAILURE false."""

    SUCCESS = 0
    BUSY = 1
    FAILURE = 2
    INVALID = 3
    ALARM = 4
    NOT_READY = 5
    MP_FAILURE = 6


class Invalid(IntEnum):
    """Values of `MotionReply.subcode` where the result is INVALID: what is wrong."""

    UNSPECIFIED = 3000
    MSGSIZE = 3001
    MSGHEADER = 3002
    MSGTYPE = 3003
    GROUPNO = 3004
    SEQUENCE = 3005
    COMMAND = 3006
    DATA = 3010
    DATA_START_POS = 3011
    DATA_POSITION = 3012
    DATA_SPEED = 3013
    DATA_ACCEL = 3014
    DATA_INSUFFICIENT = 3015
    DATA_TIME = 3016
    DATA_TOOLNO = 3017


class NotReady(IntEnum):
    """Values of `MotionReply.subcode` where the result is NOT_READY: what is missing.

    CHECK_MOTION_READY has them with the result FAILURE, too.
    """

    UNSPECIFIED = 5000
    ALARM = 5001
    ERROR = 5002
    ESTOP = 5003
    NOT_PLAY = 5004
    NOT_REMOTE = 5005
    SERVO_OFF = 5006
    HOLD = 5007
    NOT_STARTED = 5008
    WAITING_ROS = 5009
    SKILLSEND = 5010
    PFL_ACTIVE = 5011
    INC_MOVE_ERROR = 5012
