# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state port: periodic state messages in every condition, and replies to requests."""

from collections.abc import Callable, Iterator
from itertools import cycle

from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.ports import Answers, Send, answer_frame
from epson_driver.simple_message import (
    Framer,
    Message,
    MessageType,
    encode,
    topic,
)

MAX_CATCH_UP_SLOTS = 200
"""Maximum slots to catch up on after a scheduling delay, 1 s at 200 Hz.

A controller measures in each of its cycles. Late messages of the simulation therefore contain the
state at the time of their slot. After a longer delay, older slots are dropped, because clients do
not need them and each costs 0.1 ms of the process.
"""

_Slot = tuple[Callable[[], Message], ...]
"""The messages of one time slot."""


class StateSession:
    """Sends one client the joints every `state_period` s, and a STATUS after some.

    Each message has the state at the time of its slot, even if it is sent late.
    """

    def __init__(self, controller: Controller, send: Send) -> None:
        self._dialect = controller.dialect
        self._send = send
        self._framer = Framer(self._dialect.byte_order)
        profile = controller.profile.state
        feedback = profile.message == 'joint_feedback'
        joints = controller.joint_feedback if feedback else controller.joint_position
        self._answers: Answers = {
            MessageType.JOINT_POSITION: controller.joint_position,
            MessageType.STATUS: controller.status,
            MessageType.GET_VERSION: controller.version,
        }
        slots: list[_Slot] = [(joints,)] * profile.joint_positions_per_status
        if profile.status_with_joints:
            slots[-1] = (joints, controller.status)
        else:
            slots.append((controller.status,))
        self._slots: Iterator[_Slot] = cycle(slots)
        self._timer = controller.clock.every(
            controller.state_period, self._tick, catch_up=MAX_CATCH_UP_SLOTS
        )
        self._open = True

    def receive(self, data: bytes) -> None:
        """Answer requests for the messages that are also sent periodically. Raises FrameError."""
        self._framer.receive_data(data)
        while self._open and (frame := self._framer.next_frame()) is not None:
            reply = answer_frame(frame, self._answers)
            if reply is not None:
                self._send(encode(reply, self._dialect))

    def closed(self) -> None:
        """Stop sending."""
        self._open = False
        self._timer.cancel()

    def _tick(self) -> None:
        for message in next(self._slots):
            self._send(encode(topic(message()), self._dialect))
