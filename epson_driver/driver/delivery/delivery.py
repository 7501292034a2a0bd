# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Delivery of trajectories to a controller as messages.

A goal sends one message at a time, and waits for its reply before the next message. The kind of
delivery (a subclass of Delivery) determines the messages and their replies:

* streaming (streaming.py): each point is a request with a reply. Motoman uses the same scheme with
  its own messages;
* download (download.py): points are topics without replies. A point counts as acknowledged when it
  has been sent;
* statements (statements.py): each motion is one SPEL+ statement, sent over Remote Ethernet. The
  reply arrives when the motion is over;
* rtmc (real_time.py): the driver smooths the points itself, and sends the motion as real-time
  targets. A point counts as acknowledged when the smoother has accepted it.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.driver.state.joint_mapping import JointMapping
from epson_driver.link import Link
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.motion.setpoint_tracker import SetpointTracker
from epson_driver.profiles import ControllerProfile
from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.simple_message import Message, Packet

Interface = Literal['streaming', 'download', 'statements', 'rtmc']

OnReply = Callable[[Packet, float], None]
"""on_reply(packet, now) is called with the reply to a message. now: the event loop's time, s."""


@dataclass(frozen=True)
class DeliveryRules:
    """Rules for sending points to a controller (docs/controllers.md describes the values)."""

    interface: Interface = 'streaming'
    point_message: Literal['joint_traj_pt', 'joint_traj_pt_full'] = 'joint_traj_pt'
    motoman: bool = False  # points need Motoman's commands
    uses: FieldsUsed = FieldsUsed.BOTH  # which fields of a JOINT_TRAJ_PT it uses
    speed: float = 1.0  # fixed, of a controller that uses none, a fraction of the maximum
    buffer: int = 1000  # maximum number of points of a download
    dead_time: float = 0.0  # start delay of a download per point, s
    power: Literal['high', 'low'] = 'low'  # motor power that SPEL+ statements set
    slowest: float = 0.0  # minimum speed of the controller, a fraction of the maximum
    announces_streams: bool = False  # they start with START_TRAJECTORY_STREAMING


LOW_POWER = 0.05  # maximum speed in low power mode, as a fraction of full speed
WHOLE_PERCENT = 0.01  # minimum of the SPEL+ statement `Speed`, 1 %, as a fraction


def delivery_rules(
    profile: ControllerProfile, interface: Interface, message: str
) -> DeliveryRules:
    """Return the rules for sending points to a controller as messages of type `message`."""
    motoman = profile.program.kind == 'motoman'
    full = message == 'joint_traj_pt_full'
    usual = profile.program.interface
    if {'statements', 'rtmc'} & {interface, usual} and interface != usual:
        raise ValueError(
            f'parameter interface = {interface}: the controller {profile.name} supports {usual}'
        )
    if interface == 'download' and full:
        raise ValueError(
            'parameter interface = download: points are downloaded as joint_traj_pt only, but '
            f'point_message = {message}'
        )
    if motoman and not full:
        raise ValueError(
            f'parameter point_message = {message}: the controller {profile.name} '
            'supports joint_traj_pt_full only'
        )
    download = profile.program.download
    return DeliveryRules(
        interface=interface,
        point_message='joint_traj_pt_full' if full else 'joint_traj_pt',
        motoman=motoman,
        uses=FieldsUsed(profile.program.uses),
        speed=min(profile.motion.speed, 1.0 if profile.motion.power == 'high' else LOW_POWER),
        buffer=download.buffer,
        dead_time=download.dead_time,
        power=profile.motion.power,
        announces_streams=profile.error_texts == 'epson',  # other programs may refuse it
        slowest=WHOLE_PERCENT if profile.spel.project or usual == 'statements' else 0.0,
    )


@dataclass(frozen=True)
class PreparedTrajectory:
    """A trajectory and its messages. `delay`: time from its first message to the motion, s."""

    trajectory: Trajectory
    messages: Sequence[Message]  # may be created on access (LazyPoints)
    delay: float = 0.0


class Delivery(ABC):
    """Interface for sending trajectories and setpoints over a motion link."""

    resumes = False  # the first point resumes a paused controller, or is rejected with the reason
    keeps_points = False  # points of a lost client are executed when a client connects again
    lead = 0.0  # time by which the arm is later than a command of a stream, s
    no_streams = ''  # why the controller cannot follow setpoints
    no_plans = ''  # why the controller cannot execute trajectories of several points

    def __init__(
        self, link: Link, limits: JointLimits, mapping: JointMapping, rules: DeliveryRules
    ) -> None:
        self._link = link
        self._limits = limits
        self._mapping = mapping
        self._rules = rules

    def scale(self, requested: Callable[[], float]) -> Callable[[], float] | None:
        """Execute trajectories at the requested speed factor, above 0, even after their points.

        Return a function for the actual factor. None: the points must be slower instead.
        """
        return None

    @abstractmethod
    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        """Return the messages for a checked trajectory. `start`: the arm's position, (n,), rad."""

    def setpoint(self, step: Trajectory, sequence: int) -> Message:
        """Return the message for one setpoint of a stream, with the number `sequence`.

        `step`: two points, the previous setpoint and this setpoint. In the first step of a stream,
        both points are the arm's position.
        """
        raise GoalRejectedError(ErrorCode.INVALID_GOAL, self.no_streams)

    def tracker(self, limits: JointLimits, start: Array) -> SetpointTracker:
        """Return a tracker that follows a stream of setpoints, from rest at `start`."""
        return SetpointTracker(limits, start)

    @abstractmethod
    def post(self, message: Message, on_reply: OnReply) -> None:
        """Send a prepared message or STOP. Raises ConnectionError if no link is available."""
