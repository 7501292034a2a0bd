# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The message bodies as values. Joint data is in rad (or m), always ten numbers, time in s.

A class lists its fields in wire order. `layouts.py` defines their widths.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from epson_driver.simple_message.constants import MAX_JOINTS, Mode, TriState

ZEROS: tuple[float, ...] = (0.0,) * MAX_JOINTS


def joint_data(values: Sequence[float]) -> tuple[float, ...]:
    """Pad joint values with 0.0 to the ten values of a message."""
    if len(values) > MAX_JOINTS:
        raise ValueError(f'{len(values)} joints: a message carries at most {MAX_JOINTS}')
    return tuple(values) + ZEROS[len(values) :]


class Message:
    """Base of every message body, for types only. A vendor's message is another subclass."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Ping(Message):
    """PING (1). The C++ library sends no body, REP-I0006 ten zeros. Both are a `Ping`."""

    padding: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class GetVersion(Message):
    """GET_VERSION (2): an empty request, and a reply with (major, minor, patch)."""

    version: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class JointPosition(Message):
    """JOINT_POSITION (10): the joint positions, and the usual body of a reply."""

    sequence: int = 0
    joints: tuple[float, ...] = ZEROS


@dataclass(frozen=True, slots=True)
class JointTrajPt(Message):
    """JOINT_TRAJ_PT (11): one point of a trajectory.

    `velocity`: fraction of the joints' maximum speed, (0, 1]. `duration`: time from the previous
    point, s. A negative `sequence` is a `SpecialSequence`.
    """

    sequence: int
    joints: tuple[float, ...] = ZEROS
    velocity: float = 0.0
    duration: float = 0.0


@dataclass(frozen=True, slots=True)
class JointTraj(Message):
    """JOINT_TRAJ (12): a whole trajectory in one message, at most 200 points."""

    points: tuple[JointTrajPt, ...] = ()


@dataclass(frozen=True, slots=True)
class Status(Message):
    """STATUS (13). The tri-state fields hold `TriState` numbers, `mode` a `Mode` number."""

    drives_powered: int = TriState.UNKNOWN
    e_stopped: int = TriState.UNKNOWN
    error_code: int = 0
    in_error: int = TriState.UNKNOWN
    in_motion: int = TriState.UNKNOWN
    mode: int = Mode.UNKNOWN
    motion_possible: int = TriState.UNKNOWN


@dataclass(frozen=True, slots=True)
class JointTrajPtFull(Message):
    """JOINT_TRAJ_PT_FULL (14). `valid_fields` are `ValidFields` bits, `time` is from the start."""

    robot_id: int
    sequence: int
    valid_fields: int
    time: float = 0.0
    positions: tuple[float, ...] = ZEROS
    velocities: tuple[float, ...] = ZEROS
    accelerations: tuple[float, ...] = ZEROS


@dataclass(frozen=True, slots=True)
class JointFeedback(Message):
    """JOINT_FEEDBACK (15): measured values like JOINT_TRAJ_PT_FULL, without a sequence."""

    robot_id: int
    valid_fields: int
    time: float = 0.0
    positions: tuple[float, ...] = ZEROS
    velocities: tuple[float, ...] = ZEROS
    accelerations: tuple[float, ...] = ZEROS


@dataclass(frozen=True, slots=True)
class MotionCtrl(Message):
    """MOTION_CTRL (2001), Motoman: a command to the controller (`motoman.Command`).

    `sequence`: number chosen by the client and returned in the reply. `data` is reserved.
    """

    robot_id: int
    sequence: int
    command: int
    data: tuple[float, ...] = ZEROS


@dataclass(frozen=True, slots=True)
class MotionReply(Message):
    """MOTION_REPLY (2002), Motoman: the reply to MOTION_CTRL and JOINT_TRAJ_PT_FULL.

    `command`: the answered command, or the message type of a point. `result`: a `motoman.Result`.
    `subcode`: its details. `data` is reserved.
    """

    robot_id: int
    sequence: int
    command: int
    result: int
    subcode: int = 0
    data: tuple[float, ...] = ZEROS


@dataclass(frozen=True, slots=True)
class Opaque(Message):
    """Any other message, or a reply whose body does not match its type, as unmodified bytes."""

    msg_type: int
    body: bytes = b''
