# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The download interface: a whole trajectory is sent before the arm moves.

It follows ROS-Industrial's motion_download_interface. All points are sent as topics. The first
point has the sequence number -1, the last point -3, and every other point its index. A trajectory
of one point is sent as two points. STOP is sent as a request.

Points have no replies, so only the robot state shows whether the arm has executed them. Therefore
a trajectory that exceeds the controller's buffer is rejected before any point is sent.
"""

import asyncio
from dataclasses import replace

import numpy as np

from epson_driver.driver.delivery.delivery import Delivery, OnReply, PreparedTrajectory
from epson_driver.driver.delivery.streaming import MIN_DURATION_S, STOP, trajectory_points
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

MAX_UNSENT_BYTES = 16384  # the next point waits while more are in the send buffer
MAX_START_DELAY_S = 0.1  # maximum start delay beyond the dead times of all points, s
UNSENT_CHECK_PERIOD_S = 0.005  # period for checking whether the send buffer has space, s

ASSUMED_REPLY = reply(JointPosition(), ReplyCode.SUCCESS)
"""Packet that `on_reply` receives after a point, because topics have no replies."""


class Download(Delivery):
    no_streams = (
        'with interface: download the arm follows no setpoint streams, because it starts after '
        'the last point of a trajectory: send trajectories'
    )

    def prepare(self, trajectory: Trajectory, start: Array) -> PreparedTrajectory:
        points = trajectory_points(
            trajectory, start, self._limits, self._mapping, self._rules.uses
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
        """Send a point or STOP. For a point, `on_reply` is called when the next may be sent."""
        if message == STOP:
            self._link.post(message, on_reply)
            return
        self._link.send_topic(message)
        asyncio.get_running_loop().call_soon(self._acknowledge, on_reply)

    def _acknowledge(self, on_reply: OnReply) -> None:
        loop = asyncio.get_running_loop()
        if self._link.unsent > MAX_UNSENT_BYTES:
            loop.call_later(UNSENT_CHECK_PERIOD_S, self._acknowledge, on_reply)
        else:
            on_reply(ASSUMED_REPLY, loop.time())


def download_sequences(points: list[JointTrajPt]) -> list[JointTrajPt]:
    """Return `points` with the sequence numbers of a download. Duplicate a single point."""
    if len(points) == 1:
        points = [*points, replace(points[0], duration=MIN_DURATION_S)]
    first, *between, last = points
    return [
        replace(first, sequence=SpecialSequence.START_TRAJECTORY_DOWNLOAD),
        *between,
        replace(last, sequence=SpecialSequence.END_TRAJECTORY),
    ]


def _twice(trajectory: Trajectory) -> Trajectory:
    times = np.array([0.0, MIN_DURATION_S]) + trajectory.times[0]
    return Trajectory(trajectory.joint_names, times, np.repeat(trajectory.positions, 2, axis=0))
