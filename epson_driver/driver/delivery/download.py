# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The download interface: a whole trajectory is sent before the arm moves.

It follows ROS-Industrial's motion_download_interface. All points are topics. The first has the
sequence -1, the last -3, and the others their index. A trajectory of one point is sent as two.
STOP is a request.

Points have no replies. Only the state shows that the arm has executed its motion, or why it has
not. Points that would be lost are therefore refused before any is sent.
"""

import asyncio
from dataclasses import replace

import numpy as np

from epson_driver.driver.delivery.delivery import Delivery, OnReply, PreparedTrajectory
from epson_driver.driver.delivery.trajectory_points import MIN_DURATION_S, STOP, trajectory_points
from epson_driver.driver.outcome import ErrorCode, GoalRejectedError
from epson_driver.motion import Array, Trajectory
from epson_driver.simple_message import (
    JointPosition,
    JointTrajPt,
    Message,
    ReplyCode,
    SpecialSequence,
    reply,
)

MAX_UNSENT_BYTES = 16384
"""Maximum number of bytes waiting for the controller before another point is sent."""

MAX_START_DELAY_S = 0.1
"""Maximum time from the end of all points' dead times until the arm starts to move, s."""

UNSENT_CHECK_PERIOD_S = 0.005
"""Period for checking whether the controller has read the points sent, s."""

ASSUMED_REPLY = reply(JointPosition(), ReplyCode.SUCCESS)
"""Passed to `on_reply` in place of a reply, because a topic has none."""


class Download(Delivery):
    """Points as topics. From `rules`, `buffer`, `dead_time` and `uses` are used."""

    no_streams = (
        'with interface: download the arm follows no setpoint streams, because it starts after '
        'the last point of a trajectory: send trajectories'
    )

    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        """Return at least two points. Raises GoalRejectedError if the buffer is too small."""
        points = trajectory_points(
            trajectory,
            start,
            self._limits,
            self._mapping,
            self._rules.uses,
        )
        numbered = download_sequences(points)
        if len(points) == 1:
            trajectory = _twice(trajectory)
        if len(numbered) > self._rules.buffer:
            raise GoalRejectedError(
                ErrorCode.INVALID_GOAL,
                f'the trajectory has {len(numbered)} points, but the controller keeps '
                f'{self._rules.buffer} of a download: use fewer points, or interface: streaming',
            )
        return PreparedTrajectory(
            trajectory, list(numbered), len(numbered) * self._rules.dead_time + MAX_START_DELAY_S
        )

    def post(self, message: Message, on_reply: OnReply) -> None:
        """Send a point, which soon counts as answered, or STOP, which the controller answers."""
        if message == STOP:
            self._link.post(message, on_reply)
            return
        self._link.send_topic(message)
        asyncio.get_running_loop().call_soon(self._go_on, on_reply)

    def _go_on(self, on_reply: OnReply) -> None:
        loop = asyncio.get_running_loop()
        if self._link.unsent > MAX_UNSENT_BYTES:
            loop.call_later(UNSENT_CHECK_PERIOD_S, self._go_on, on_reply)
        else:
            on_reply(ASSUMED_REPLY, loop.time())


def download_sequences(points: list[JointTrajPt]) -> list[JointTrajPt]:
    """Return points numbered 0, 1, 2, … with the sequences of a download.

    A single point becomes two with the same position.
    """
    if len(points) == 1:
        points = [*points, replace(points[0], duration=MIN_DURATION_S)]
    first, *between, last = points
    return [
        replace(first, sequence=SpecialSequence.START_TRAJECTORY_DOWNLOAD),
        *between,
        replace(last, sequence=SpecialSequence.END_TRAJECTORY),
    ]


def _twice(trajectory: Trajectory) -> Trajectory:
    """Return a trajectory of one point with that point repeated."""
    times = np.array([0.0, MIN_DURATION_S]) + trajectory.times[0]
    return Trajectory(trajectory.joint_names, times, np.repeat(trajectory.positions, 2, axis=0))
