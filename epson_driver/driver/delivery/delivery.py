# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Delivery of trajectories to a controller: their messages, and how these are sent.

The execution of a goal posts one message at a time, and the next one when that is answered. Goal
execution, STOP and the end of a goal are the same for all deliveries:

* streaming (streaming.py): each point is a request with a reply. Motoman uses the same scheme with
  its own messages;
* download (download.py): points are topics, and each counts as answered when it is sent;
* statements (statements.py): one SPEL+ statement by Remote Ethernet for each motion, answered when
  the motion is over.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.driver.state.joint_mapping import JointMapping
from epson_driver.link import Link
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.simple_message import Message, Packet

Interface = Literal['streaming', 'download', 'statements']

OnReply = Callable[[Packet, float], None]
"""on_reply(packet, now) is called when a message is answered. now: the loop's time, s."""


@dataclass(frozen=True)
class DeliveryRules:
    """Rules of a controller for points, from the parameters and its profile.

    motoman: points need Motoman's commands. uses: fields of a JOINT_TRAJ_PT that are used.
    speed: fraction, for a controller that uses none of them. slowest: minimum speed, a fraction,
    for any other controller. buffer, dead_time (s per point): for a download. power: requested by
    statements. The values have the meaning defined for profiles (docs/controllers.md).
    """

    interface: Interface = 'streaming'
    point_message: Literal['joint_traj_pt', 'joint_traj_pt_full'] = 'joint_traj_pt'
    motoman: bool = False
    uses: FieldsUsed = FieldsUsed.BOTH
    speed: float = 1.0
    buffer: int = 1000
    dead_time: float = 0.0
    power: Literal['high', 'low'] = 'low'
    slowest: float = 0.0


@dataclass(frozen=True)
class PreparedTrajectory:
    """A trajectory as it is executed, and its messages in the order in which they are posted.

    The messages may be created on access (trajectory_points.py).

    delay: time from the first message until the controller starts to move the arm, s.
    """

    trajectory: Trajectory
    messages: Sequence[Message]
    delay: float = 0.0


class Delivery(ABC):
    """Interface to a controller over a motion link, for joints within limits.

    `resumes`: the first point resumes a paused controller, or its reply contains why not.
    `keeps_points`: the controller keeps its points when the client is lost, and resumes them as
    soon as a client connects. `no_streams`: why setpoints cannot be followed, or ''.
    """

    resumes = False
    keeps_points = False
    no_streams = ''

    def __init__(
        self, link: Link, limits: JointLimits, mapping: JointMapping, rules: DeliveryRules
    ) -> None:
        self._link = link
        self._limits = limits
        self._mapping = mapping
        self._rules = rules

    @abstractmethod
    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        """Return the messages for a checked trajectory from `start` (shape (n,), rad).

        Raises GoalRejectedError if the controller cannot execute it.
        """

    def setpoint(self, way: Trajectory, sequence: int) -> Message:
        """Return the message for one setpoint of a stream, with the number `sequence`.

        `way` has two points: the previous setpoint and this one. For the first setpoint both have
        the same time, and the arm's position. Raises GoalRejectedError if the controller takes no
        streams.
        """
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, self.no_streams)

    def post(self, message: Message, on_reply: OnReply) -> None:
        """Send a prepared message or STOP. Raises ConnectionError if no link is available."""
        self._link.post(message, on_reply)
