# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How trajectories reach a controller: the messages that are made of one, and how they are sent.

A goal's execution posts one message at a time, and the next one when that is answered. It is the
same for all deliveries, and so are STOP and the end of a goal:

* streaming (streaming.py): each point is a request, and its reply is the answer; Motoman as well,
  in messages of its own;
* download (download.py): points are topics; each counts as answered when it is sent;
* statements (statements.py): SPEL+ by Remote Ethernet, one for all of a motion, answered when it
  is over.
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

OnReply = Callable[[Packet, float], None]
"""on_reply(packet, now) is called when a message is answered; now: the loop's time, s."""


@dataclass(frozen=True)
class DeliveryRules:
    """Which points the controller takes, by parameters and its profile.

    motoman: its points need Motoman's commands. uses: which fields of a JOINT_TRAJ_PT count;
    speed: a fraction, of a controller that uses none of them. slowest: the smallest speed, a
    fraction, of any other. buffer, dead_time (s per point): of a download. power: what statements
    ask for. All as in the profile (docs/controllers.md).
    """

    interface: Literal['streaming', 'download', 'statements'] = 'streaming'
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
    """A trajectory as it is executed, and its messages, in the order in which they are posted.

    They may be made only when they are asked for (trajectory_points.py).

    delay: how long after the first of them the controller lets the arm stand before it moves, s.
    """

    trajectory: Trajectory
    messages: Sequence[Message]
    delay: float = 0.0


class Delivery(ABC):
    """A way to a controller, over a motion link, for joints within limits.

    `resumes`: its first point makes a controller go on that is paused, or says why not.
    `keeps_points`: a controller of this kind keeps its points when the client is lost, and goes
    on with them as soon as one connects. `no_streams`: why it follows no setpoints, or ''.
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

        Raises GoalRejectedError if the controller cannot take it.
        """

    def setpoint(self, way: Trajectory, sequence: int) -> Message:
        """Return the message for one setpoint of a stream, with the number `sequence`.

        `way` has two points: the setpoint before, and this one; with the same time they are the
        first, where the arm stands. Raises GoalRejectedError if the controller takes no streams.
        """
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, self.no_streams)

    def post(self, message: Message, on_reply: OnReply) -> None:
        """Send one of them, or STOP. Raises ConnectionError if there is no link."""
        self._link.post(message, on_reply)
