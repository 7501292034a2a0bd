# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Delivery of trajectories to a controller as messages.

A goal sends one message at a time, and the next one after the reply. The kind of delivery (a
subclass of Delivery) determines the messages and their replies:

* streaming (streaming.py): each point is a request with a reply. Motoman uses the same scheme with
  its own messages;
* download (download.py): points are topics without replies. A point counts as acknowledged when it
  has been sent;
* statements (statements.py): each motion is one SPEL+ statement, sent over Remote Ethernet. The
  reply arrives when the motion is over.
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
"""on_reply(packet, now) is called with the reply to a message. now: the event loop's time, s."""


@dataclass(frozen=True)
class DeliveryRules:
    """Rules for sending points to a controller, from the parameters and its profile.

    docs/controllers.md describes the values.

    * `motoman`: points need Motoman's commands.
    * `uses`: which of the fields velocity and duration of a JOINT_TRAJ_PT the controller uses.
    * `speed`: fixed speed of a controller that uses no such field, a fraction of the maximum.
    * `slowest`: minimum speed of the controller, a fraction of the maximum.
    * `buffer`: maximum number of points of a download.
    * `dead_time`: start delay of a download per point, s.
    * `power`: motor power that SPEL+ statements set.
    * `announces_streams`: the first setpoint of a stream has the sequence
      START_TRAJECTORY_STREAMING instead of 0.
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
    announces_streams: bool = False


@dataclass(frozen=True)
class PreparedTrajectory:
    """A trajectory and its messages, in the order in which they are sent.

    * `messages`: may be created on access (LazyPoints).
    * `delay`: time from the first message until the controller starts to move the arm, s.
    """

    trajectory: Trajectory
    messages: Sequence[Message]
    delay: float = 0.0


class Delivery(ABC):
    """Interface for sending trajectories and setpoints over a motion link.

    * `resumes`: the first point resumes a paused controller, or is rejected with the reason.
    * `keeps_points`: the controller keeps its points when the client is lost, and executes them
      when a client connects again.
    * `no_streams`: why the controller cannot follow setpoints, or ''.
    * `no_plans`: why the controller cannot execute trajectories of several points, or ''.
    """

    resumes = False
    keeps_points = False
    no_streams = ''
    no_plans = ''

    def __init__(
        self, link: Link, limits: JointLimits, mapping: JointMapping, rules: DeliveryRules
    ) -> None:
        self._link = link
        self._limits = limits
        self._mapping = mapping
        self._rules = rules

    @abstractmethod
    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        """Return the messages for a checked trajectory of an arm at `start` (shape (n,), rad).

        Raises GoalRejectedError if the controller cannot execute the trajectory.
        """

    def setpoint(self, step: Trajectory, sequence: int) -> Message:
        """Return the message for one setpoint of a stream, with the number `sequence`.

        `step` has two points: the previous setpoint and this one. For the first setpoint both are
        the arm's position at the same time. Raises GoalRejectedError if the controller cannot
        follow setpoints.
        """
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, self.no_streams)

    def post(self, message: Message, on_reply: OnReply) -> None:
        """Send a prepared message or STOP. Raises ConnectionError if no link is available."""
        self._link.post(message, on_reply)
