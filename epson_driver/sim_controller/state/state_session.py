# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state port: the state sent by the clock, in every condition, and requests answered."""

from collections.abc import Callable, Iterator
from itertools import cycle
from typing import TYPE_CHECKING

from epson_driver.sim_controller.ports.requests import Answers, answer_frame
from epson_driver.sim_controller.ports.session import Send
from epson_driver.simple_message import Framer, Message, MessageType, encode, topic

if TYPE_CHECKING:
    from epson_driver.sim_controller.core import Controller


class StateSession:
    """Sends one client the joints every period, and a STATUS in a slot of its own after some."""

    def __init__(self, controller: 'Controller', send: Send) -> None:
        self._controller = controller
        self._send = send
        self._framer = Framer(controller.dialect.byte_order)
        state = controller.profile.state
        feedback = state.message == 'joint_feedback'
        joints = controller.joint_feedback if feedback else controller.joint_position
        self._answers: Answers = {
            MessageType.JOINT_POSITION: controller.joint_position,
            MessageType.STATUS: controller.status,
        }
        self._slots: Iterator[Callable[[], Message]] = cycle(
            (joints,) * state.joint_positions_per_status + (controller.status,)
        )
        self._timer = controller.clock.every(controller.state_period, self._tick)
        self._open = True

    def receive(self, data: bytes) -> None:
        """Answer requests for what is sent anyway. Raises FrameError."""
        self._framer.receive_data(data)
        while self._open and (frame := self._framer.next_frame()) is not None:
            reply = answer_frame(frame, self._answers)
            if reply is not None:
                self._send(encode(reply, self._controller.dialect))

    def closed(self) -> None:
        """Send nothing any more."""
        self._open = False
        self._timer.cancel()

    def _tick(self) -> None:
        self._send(encode(topic(next(self._slots)()), self._controller.dialect))
