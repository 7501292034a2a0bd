# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Classes of the message bodies, with the fields in wire order. `layouts.py` defines their widths.

Positions are in rad, or m for prismatic joints, and times in s. Joint data always has ten values.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from epson_driver.simple_message.constants import MAX_JOINTS, Mode, TriState

ZEROS: tuple[float, ...] = (0.0,) * MAX_JOINTS


def joint_data(values: Sequence[float]) -> tuple[float, ...]:
    """Return joint values padded with 0.0 to ten values. Raises ValueError if there are more."""
    if len(values) > MAX_JOINTS:
        raise ValueError(f'{len(values)} joints: a message carries at most {MAX_JOINTS}')
    return tuple(values) + ZEROS[len(values) :]


class Message:
    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Ping(Message):
    """PING (1). ROS-Industrial's C++ library sends no body. REP-I0006 specifies ten zeros."""

    padding: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class GetVersion(Message):
    """GET_VERSION (2). `version` is empty in a request, and (major, minor, patch) in a reply."""

    version: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class JointPosition(Message):
    """JOINT_POSITION (10): joint positions in a topic, or the reply to a point."""

    sequence: int = 0
    joints: tuple[float, ...] = ZEROS


@dataclass(frozen=True, slots=True)
class JointTrajPt(Message):
    """JOINT_TRAJ_PT (11): one point of a trajectory.

    `velocity`: fraction of the joints' maximum speed, (0, 1]. `duration`: time since the previous
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
    """STATUS (13). `mode` is a `Mode`, `error_code` any number, every other field a `TriState`."""

    drives_powered: int = TriState.UNKNOWN
    e_stopped: int = TriState.UNKNOWN
    error_code: int = 0
    in_error: int = TriState.UNKNOWN
    in_motion: int = TriState.UNKNOWN
    mode: int = Mode.UNKNOWN
    motion_possible: int = TriState.UNKNOWN


@dataclass(frozen=True, slots=True)
class JointTrajPtFull(Message):
    """JOINT_TRAJ_PT_FULL (14): one point of a trajectory with velocities and accelerations.

    `valid_fields` are `ValidFields` bits. `time` is the time from the start of the trajectory, s.
    """

    robot_id: int
    sequence: int
    valid_fields: int
    time: float = 0.0
    positions: tuple[float, ...] = ZEROS
    velocities: tuple[float, ...] = ZEROS
    accelerations: tuple[float, ...] = ZEROS


@dataclass(frozen=True, slots=True)
class JointFeedback(Message):
    """JOINT_FEEDBACK (15): measured values. `valid_fields` are `ValidFields` bits."""

    robot_id: int
    valid_fields: int
    time: float = 0.0
    positions: tuple[float, ...] = ZEROS
    velocities: tuple[float, ...] = ZEROS
    accelerations: tuple[float, ...] = ZEROS


@dataclass(frozen=True, slots=True)
class MotionCtrl(Message):
    """MOTION_CTRL (2001), Motoman: a command to the controller (`motoman.Command`).

    `sequence` is chosen by the client and repeated in the reply. `data` is reserved.
    """

    robot_id: int
    sequence: int
    command: int
    data: tuple[float, ...] = ZEROS


@dataclass(frozen=True, slots=True)
class MotionReply(Message):
    """MOTION_REPLY (2002), Motoman: the reply to MOTION_CTRL and JOINT_TRAJ_PT_FULL.

    `command` is the command of the request or, for a point, its message type. `result` is a
    `motoman.Result`, and `subcode` has details of it. `data` is reserved.
    """

    robot_id: int
    sequence: int
    command: int
    result: int
    subcode: int = 0
    data: tuple[float, ...] = ZEROS


@dataclass(frozen=True, slots=True)
class Opaque(Message):
    """The raw bytes of a message of unknown type, or of a reply that does not fit its type."""

    msg_type: int
    body: bytes = b''
