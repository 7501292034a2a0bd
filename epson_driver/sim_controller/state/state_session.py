# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state port: the state sent by the clock, in every condition, and requests answered."""

from collections.abc import Callable, Iterator
from itertools import cycle
from typing import Protocol

from epson_driver.profiles.profile import StateProfile
from epson_driver.sim_controller.clock import Clock
from epson_driver.sim_controller.ports.requests import Answers, answer_frame
from epson_driver.sim_controller.ports.session import Send
from epson_driver.simple_message import (
    Dialect,
    Framer,
    JointFeedback,
    JointPosition,
    Message,
    MessageType,
    Status,
    encode,
    topic,
)


class StateSource(Protocol):
    """What can be told of the controller."""

    def joint_position(self) -> JointPosition:
        """Return where the encoders say that the joints are."""

    def joint_feedback(self) -> JointFeedback:
        """Return where the joints are and how fast, with the controller's time."""

    def status(self) -> Status:
        """Return what STATUS says now."""


class StateSession:
    """Sends one client the joints every `period` s, and a STATUS in a slot of its own after some.

    `profile` says which message has the joints, and how many slots are between two STATUS.
    """

    def __init__(
        self,
        source: StateSource,
        profile: StateProfile,
        period: float,
        dialect: Dialect,
        clock: Clock,
        send: Send,
    ) -> None:
        self._dialect = dialect
        self._send = send
        self._framer = Framer(dialect.byte_order)
        feedback = profile.message == 'joint_feedback'
        joints = source.joint_feedback if feedback else source.joint_position
        self._answers: Answers = {
            MessageType.JOINT_POSITION: source.joint_position,
            MessageType.STATUS: source.status,
        }
        self._slots: Iterator[Callable[[], Message]] = cycle(
            (joints,) * profile.joint_positions_per_status + (source.status,)
        )
        self._timer = clock.every(period, self._tick)
        self._open = True

    def receive(self, data: bytes) -> None:
        """Answer requests for the messages that are also sent unasked. Raises FrameError."""
        self._framer.receive_data(data)
        while self._open and (frame := self._framer.next_frame()) is not None:
            reply = answer_frame(frame, self._answers)
            if reply is not None:
                self._send(encode(reply, self._dialect))

    def closed(self) -> None:
        """Send nothing any more."""
        self._open = False
        self._timer.cancel()

    def _tick(self) -> None:
        self._send(encode(topic(next(self._slots)()), self._dialect))
