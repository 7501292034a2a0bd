# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The motion port: one client's bytes to the motion program, its replies back."""

from typing import Protocol

from epson_driver.sim_controller.condition.errors import ErrorNumber, Rejection
from epson_driver.sim_controller.ports.session import Send
from epson_driver.sim_controller.programs.client_watchdog import ClientWatchdog
from epson_driver.sim_controller.programs.program import Program
from epson_driver.simple_message import ByteOrder, FrameError, Framer


class MotionServer(Protocol):
    """The controller, as far as its motion client reaches it."""

    reply: Send | None
    """Where replies go; None without a client."""

    @property
    def program(self) -> Program:
        """What serves the client."""

    def show(self, rejection: Rejection) -> None:
        """Show in STATUS why something was rejected."""

    def client_came(self) -> None:
        """Begin to serve a motion client."""

    def client_lost(self) -> None:
        """Do what this kind of controller does without its motion client."""


class MotionSession:
    """The session of the one motion client, until that is gone, for whatever reason.

    `watchdog` hears every message; None: the client may be silent.
    """

    def __init__(
        self,
        controller: MotionServer,
        byte_order: ByteOrder,
        send: Send,
        watchdog: ClientWatchdog | None = None,
    ) -> None:
        self._controller = controller
        self._watchdog = watchdog
        self._framer = Framer(byte_order)
        self._open = True
        controller.reply = send
        controller.client_came()

    def receive(self, data: bytes) -> None:
        """Obey the client, or raise FrameError, after which it counts as lost."""
        self._framer.receive_data(data)
        try:
            while self._open and (frame := self._framer.next_frame()) is not None:
                if self._watchdog is not None:
                    self._watchdog.hear(frame)
                self._controller.program.receive(frame)
        except FrameError as error:
            self._controller.show(Rejection(ErrorNumber.CORRUPT_MESSAGE, str(error)))
            self.closed()
            raise

    def closed(self) -> None:
        """The client is gone: the controller does what its kind does then."""
        if self._open:
            self._open = False
            if self._watchdog is not None:
                self._watchdog.end()
            try:
                self._controller.client_lost()
            finally:
                self._controller.reply = None
