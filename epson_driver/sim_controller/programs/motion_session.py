# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The motion port: one client's bytes to the motion program, its replies back."""

from collections.abc import Callable

from epson_driver.sim_controller.clock import Clock, Timer
from epson_driver.sim_controller.condition.errors import ErrorNumber, Rejection
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.ports import Send
from epson_driver.sim_controller.programs.motion_program import MotionProgram
from epson_driver.simple_message import Frame, FrameError, Framer

SLICES = 20
"""Number of slices of the timeout.

A slice counts once, however late its end is detected. Messages received during a scheduling delay
of this process are therefore still read.
"""


class ClientWatchdog:
    """Calls `silent` when a client that has sent a heartbeat sends nothing for `timeout` s.

    It is called once per silence, up to one slice late. `hear` gets every message of the client.

    A heartbeat is a PING as a topic, which is not answered (REP-I0006). A client that has sent
    none on its connection may be silent indefinitely, like the clients of ROS 1.
    """

    def __init__(self, clock: Clock, timeout: float, silent: Callable[[], None]) -> None:
        self._clock = clock
        self._slice = timeout / SLICES
        self._silent = silent
        self._quiet = -1
        self._timer: Timer | None = None

    def hear(self, frame: Frame) -> None:
        """Restart the timeout after a message, once a first heartbeat has arrived."""
        self._quiet = -1  # the slice in which it came does not count
        if frame.heartbeat and self._timer is None:
            self._timer = self._clock.every(self._slice, self._look, first=self._slice)

    def end(self) -> None:
        """Stop the watchdog after the client has disconnected."""
        if self._timer is not None:
            self._timer.cancel()

    def _look(self) -> None:
        self._quiet += 1
        if self._quiet == SLICES:
            self._silent()


class MotionSession:
    """The session of the one motion client, with a watchdog if the profile has one."""

    def __init__(self, controller: Controller, send: Send) -> None:
        self._controller = controller
        self._watchdog: ClientWatchdog | None = None
        program, timeout = controller.program, controller.profile.server.client_timeout
        if timeout and isinstance(program, MotionProgram):
            self._watchdog = ClientWatchdog(
                controller.clock, timeout, lambda: program.client_silent(timeout)
            )
        self._framer = Framer(controller.dialect.byte_order)
        self._open = True
        controller.reply = send
        controller.client_came()

    def receive(self, data: bytes) -> None:
        """Process the client's bytes. Raises FrameError, after which the client counts as lost."""
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
        """End the session. The controller reacts to the loss of its client."""
        if self._open:
            self._open = False
            if self._watchdog is not None:
                self._watchdog.end()
            try:
                self._controller.client_lost()
            finally:
                self._controller.reply = None
