# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motions for an RC800 with Real-time Motion Control. The driver smooths and samples them.

The setpoints of a stream are not sent as messages. The tracker of the stream (StreamFeeder) writes
the targets.
"""

from collections.abc import Callable
from dataclasses import replace

from epson_driver.driver.delivery.delivery import DeliveryRules, OnReply
from epson_driver.driver.delivery.statements import Load
from epson_driver.driver.delivery.streaming import STOP, Streaming
from epson_driver.driver.state.joint_mapping import JointMapping
from epson_driver.link.rtmc_link import RtmcLink
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.motion.setpoint_tracker import SetpointTracker
from epson_driver.rtmc.session import MM_PER_M
from epson_driver.rtmc.stream_feeder import LEAD_S, StreamFeeder
from epson_driver.simple_message import JointTrajPt, Message, SpecialSequence

SETPOINT = SpecialSequence.START_TRAJECTORY_STREAMING


class RealTimeDelivery(Streaming):
    lead = LEAD_S

    def __init__(
        self, link: RtmcLink, limits: JointLimits, mapping: JointMapping, rules: DeliveryRules
    ) -> None:
        super().__init__(link, limits, mapping, replace(rules, announces_streams=True))
        self._rtmc = link

    def set_load(self, load: Load | None) -> None:
        self._rtmc.load = None
        if load is not None:
            self._rtmc.load = load.mass, load.inertia, round(load.eccentricity * MM_PER_M)

    def scale(self, requested: Callable[[], float]) -> Callable[[], float]:
        return self._rtmc.scale(requested)

    def tracker(self, limits: JointLimits, start: Array) -> SetpointTracker:
        return StreamFeeder(limits, start, self._rtmc.follow_stream)

    def setpoint(self, step: Trajectory, sequence: int) -> Message:
        return super().setpoint(step, 0)

    def post(self, message: Message, on_reply: OnReply) -> None:
        if message == STOP:
            self._rtmc.stop(on_reply)
        elif isinstance(message, JointTrajPt) and message.sequence == SETPOINT:
            self._rtmc.accept(on_reply)
        elif isinstance(message, JointTrajPt):
            self._rtmc.move(message, on_reply)
