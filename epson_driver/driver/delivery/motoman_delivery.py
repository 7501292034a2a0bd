# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motoman's way: trajectory mode, JOINT_TRAJ_PT_FULL, and patience when its queue is full.

* Before the first point START_TRAJ_MODE is sent. It is answered SUCCESS if the mode is on already.
* A point that is answered BUSY has changed nothing; it is sent again after
  BUSY_RETRY_PERIOD_S, until it is taken or the goal is stopped.
* STOP is STOP_MOTION. The mode stays on.
* MotoROS keeps queue, job and servos when the client is lost, and goes on as soon as one connects:
  STOP_MOTION is the first message on each connection (Driver sends it).
"""

import asyncio
import contextlib

from epson_driver.driver.delivery.delivery import DeliveryRules, OnReply
from epson_driver.driver.delivery.reply_rejection import reply_rejection
from epson_driver.driver.delivery.streaming import FullStreaming
from epson_driver.driver.delivery.trajectory_points import STOP
from epson_driver.driver.state.joint_mapping import JointMapping
from epson_driver.link import Link
from epson_driver.motion import JointLimits
from epson_driver.simple_message import (
    JointTrajPtFull,
    Message,
    MotionCtrl,
    MotionReply,
    Packet,
)
from epson_driver.simple_message.motoman import Command, Result

BUSY_RETRY_PERIOD_S = 0.01
"""How long to wait before a point is sent again, s; MotoROS works in cycles of 4 ms."""


class MotomanDelivery(FullStreaming):
    """Points and STOP for a controller with MotoROS."""

    resumes = True
    keeps_points = True

    def __init__(
        self, link: Link, limits: JointLimits, mapping: JointMapping, rules: DeliveryRules
    ) -> None:
        super().__init__(link, limits, mapping, rules)
        self._trajectory = 0
        """Counts trajectories and stops: what belongs to an older one is not sent any more."""

    def post(self, message: Message, on_reply: OnReply) -> None:
        """Send a point or STOP, with what Motoman wants before or instead."""
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
