# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The streaming interface: each point is a request, and the next one is sent after its reply."""

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
    SpecialSequence,
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

    def setpoint(self, step: Trajectory, sequence: int) -> Message:
        """Return the setpoint as a JOINT_TRAJ_PT."""
        velocities = None if step.velocities is None else step.velocities[1:]
        target = Trajectory(
            step.joint_names, step.times[1:] - step.times[0], step.positions[1:], velocities
        )
        (point,) = trajectory_points(
            target, step.positions[0], self._limits, self._mapping, self._rules.uses
        )
        if not sequence and self._rules.announces_streams:
            sequence = SpecialSequence.START_TRAJECTORY_STREAMING
        return replace(point, sequence=sequence)


class FullStreaming(Delivery):
    """Points as JOINT_TRAJ_PT_FULL requests: time, positions, velocities."""

    no_streams = (  # a controller that interpolates by time stops abruptly if a point is late
        'with point_message: joint_traj_pt_full the arm follows no setpoint streams, because the '
        'controller stops abruptly if a point is late: send trajectories'
    )

    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        """Return a message for the arm's position, and one for each later point."""
        executed = with_velocities(from_standing(trajectory, start, self._limits))

        def make(first: int, end: int) -> list[JointTrajPtFull]:
            return full_points(executed, self._limits, self._mapping, first=first, end=end)

        return PreparedTrajectory(executed, LazyPoints(len(executed.times), make))


BUSY_RETRY_PERIOD_S = 0.01
"""Delay before a point with the reply BUSY is sent again, s. The cycle of MotoROS is 4 ms."""


class MotomanDelivery(FullStreaming):
    """Points and STOP for a controller with MotoROS.

    * START_TRAJ_MODE switches trajectory mode on, and is sent before the first point.
    * A point with the reply BUSY had no effect. It is sent again after BUSY_RETRY_PERIOD_S, until
      it is accepted or the goal is stopped.
    * STOP is sent as STOP_MOTION. Trajectory mode stays on.
    * MotoROS keeps its points when the client is lost, and executes them when a client connects
      again. The driver therefore sends STOP_MOTION first on each connection.
    """

    resumes = True
    keeps_points = True

    def __init__(
        self, link: Link, limits: JointLimits, mapping: JointMapping, rules: DeliveryRules
    ) -> None:
        super().__init__(link, limits, mapping, rules)
        self._trajectory = 0
        """Number of trajectories and stops so far. Older points are not sent again after BUSY."""

    def post(self, message: Message, on_reply: OnReply) -> None:
        """Send a point or STOP. START_TRAJ_MODE precedes the first point."""
        if message == STOP:
            self._trajectory += 1
            self._link.post(_command(Command.STOP_MOTION), on_reply)
        elif isinstance(message, JointTrajPtFull) and message.sequence == 0:
            self._trajectory += 1
            self._start(message, on_reply)
        else:
            self._post_point(message, on_reply)

    def _start(self, first: JointTrajPtFull, on_reply: OnReply) -> None:
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
