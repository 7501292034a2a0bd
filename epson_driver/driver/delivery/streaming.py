# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The streaming interface: each point is a request, and its reply lets the next one go."""

from dataclasses import replace

from epson_driver.driver.delivery.delivery import DeliveryRules, OnReply, PreparedTrajectory
from epson_driver.driver.delivery.trajectory_points import (
    LazyPoints,
    from_standing,
    full_points,
    trajectory_points,
    with_velocities,
)
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.driver.state.joint_mapping import JointMapping
from epson_driver.link import Link
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.simple_message import JointTrajPt, JointTrajPtFull, Message


class Streaming:
    """Points as JOINT_TRAJ_PT requests."""

    resumes = False
    keeps_points = False

    def __init__(
        self,
        link: Link,
        limits: JointLimits,
        mapping: JointMapping,
        rules: DeliveryRules,
    ) -> None:
        self._link = link
        self._limits = limits
        self._mapping = mapping
        self._rules = rules

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
        """Return it as a point of one long trajectory."""
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

    def post(self, message: Message, on_reply: OnReply) -> None:
        """Send a request."""
        self._link.post(message, on_reply)


class FullStreaming(Streaming):
    """Points as JOINT_TRAJ_PT_FULL requests: time, positions, velocities."""

    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        """Return a point where the arm stands, and one for each that follows."""
        executed = with_velocities(from_standing(trajectory, start, self._limits))

        def make(first: int, end: int) -> list[JointTrajPtFull]:
            return full_points(executed, self._limits, self._mapping, first=first, end=end)

        return PreparedTrajectory(executed, LazyPoints(len(executed.times), make))

    def setpoint(self, way: Trajectory, sequence: int) -> Message:
        """Raise GoalRejectedError: what interpolates by times stops dead if one comes late."""
        raise GoalRejectedError(
            ErrorCode.INVALID_GOAL,
            'with point_message: joint_traj_pt_full the arm follows no streams of setpoints: the '
            'controller would stop abruptly whenever one comes late; send trajectories',
        )
