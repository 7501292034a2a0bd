# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The streaming interface: each point is a request, and its reply releases the next one."""

import asyncio
import contextlib
from dataclasses import replace

from epson_driver.driver.delivery.delivery import (
    Delivery,
    DeliveryRules,
    OnReply,
    PreparedTrajectory,
)
from epson_driver.driver.delivery.reply_rejection import reply_rejection
from epson_driver.driver.delivery.trajectory_points import (
    STOP,
    LazyPoints,
    from_standing,
    full_points,
    trajectory_points,
    with_velocities,
)
from epson_driver.driver.state.joint_mapping import JointMapping
from epson_driver.link import Link
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.simple_message import (
    JointTrajPt,
    JointTrajPtFull,
    Message,
    MotionCtrl,
    MotionReply,
    Packet,
)
from epson_driver.simple_message.motoman import Command, Result


class Streaming(Delivery):
    """Points as JOINT_TRAJ_PT requests."""

    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        """Return one message for each point of the trajectory."""

        def make(first: int, end: int) -> list[JointTrajPt]:
            return trajectory_points(
                trajectory,
                start,
                self._limits,
                self._mapping,
                self._rules.uses,
                first=first,
                end=end,
            )

        return PreparedTrajectory(trajectory, LazyPoints(len(trajectory.times), make))

    def setpoint(self, way: Trajectory, sequence: int) -> Message:
        """Return the setpoint as a point of one long trajectory."""
        velocities = None if way.velocities is None else way.velocities[1:]
        one = Trajectory(
            way.joint_names, way.times[1:] - way.times[0], way.positions[1:], velocities
        )
        (point,) = trajectory_points(
            one,
            way.positions[0],
            self._limits,
            self._mapping,
            self._rules.uses,
        )
        return replace(point, sequence=sequence)


class FullStreaming(Delivery):
    """Points as JOINT_TRAJ_PT_FULL requests: time, positions, velocities."""

    no_streams = (  # a controller that interpolates by time stops abruptly if a point is late
        'with point_message: joint_traj_pt_full the arm follows no setpoint streams, because the '
        'controller stops abruptly if a point is late: send trajectories'
    )

    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        """Return a point at the arm's position, and one for each point that follows."""
        executed = with_velocities(from_standing(trajectory, start, self._limits))

        def make(first: int, end: int) -> list[JointTrajPtFull]:
            return full_points(executed, self._limits, self._mapping, first=first, end=end)

        return PreparedTrajectory(executed, LazyPoints(len(executed.times), make))


BUSY_RETRY_PERIOD_S = 0.01
"""Wait before a point is sent again, s. MotoROS works in cycles of 4 ms."""


class MotomanDelivery(FullStreaming):
    """Points and STOP for a controller with MotoROS.

    * START_TRAJ_MODE is sent before the first point. Its reply is SUCCESS if the mode is on.
    * A point with the reply BUSY had no effect. It is sent again after BUSY_RETRY_PERIOD_S, until
      it is accepted or the goal is stopped.
    * STOP is STOP_MOTION. The mode stays on.
    * MotoROS keeps queue, job and servos when the client is lost, and resumes as soon as one
      connects. STOP_MOTION is therefore the first message on each connection (Driver sends it).
    """

    resumes = True
    keeps_points = True

    def __init__(
        self, link: Link, limits: JointLimits, mapping: JointMapping, rules: DeliveryRules
    ) -> None:
        super().__init__(link, limits, mapping, rules)
        self._trajectory = 0
        """Number of trajectories and stops. Points of an older one are not sent any more."""

    def post(self, message: Message, on_reply: OnReply) -> None:
        """Send a point or STOP as Motoman's commands, trajectory mode first."""
        if message == STOP:
            self._trajectory += 1
            self._link.post(_command(Command.STOP_MOTION), on_reply)
        elif isinstance(message, JointTrajPtFull) and message.sequence == 0:
            self._trajectory += 1
            self._begin(message, on_reply)
        else:
            self._post_point(message, on_reply)

    def _begin(self, first: JointTrajPtFull, on_reply: OnReply) -> None:
        trajectory = self._trajectory

        def on_mode(packet: Packet, now: float) -> None:
            if reply_rejection(packet) is not None:
                on_reply(packet, now)
            elif trajectory == self._trajectory:
                with contextlib.suppress(ConnectionError):  # the lost link ends the goal
                    self._post_point(first, on_reply)

        self._link.post(_command(Command.START_TRAJ_MODE), on_mode)

    def _post_point(self, point: Message, on_reply: OnReply) -> None:
        trajectory = self._trajectory

        def again() -> None:
            if trajectory == self._trajectory:
                with contextlib.suppress(ConnectionError):
                    self._post_point(point, on_reply)

        def on_answer(packet: Packet, now: float) -> None:
            answer = packet.message
            if isinstance(answer, MotionReply) and answer.result == Result.BUSY:
                asyncio.get_running_loop().call_later(BUSY_RETRY_PERIOD_S, again)
            else:
                on_reply(packet, now)

        self._link.post(point, on_answer)


def _command(command: Command) -> MotionCtrl:
    return MotionCtrl(0, 0, command)
