# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Notices that a motion client hangs: one that sends heartbeats, and then nothing at all.

A heartbeat is a PING as a topic, which REP-I0006 has nobody answer. A client that has never sent
one on its connection may be silent for as long as it likes, as ROS 1's are.
"""

from collections.abc import Callable

from epson_driver.sim_controller.clock import Clock, Timer
from epson_driver.simple_message import Frame

SLICES = 10
"""The time-out is cut into so many slices, and a slice counts once, however late its end was seen:
what came while this process was not scheduled is read afterwards."""


class ClientWatchdog:
    """Calls `silent` when a client that has sent a heartbeat has sent nothing for `timeout` s.

    Once for each silence, and up to a slice earlier. `hear` takes every message of the client.
    """

    def __init__(self, clock: Clock, timeout: float, silent: Callable[[], None]) -> None:
        self._clock = clock
        self._slice = timeout / SLICES
        self._silent = silent
        self._quiet = 0
        self._timer: Timer | None = None

    def hear(self, frame: Frame) -> None:
        """Count anew after a message, once a first heartbeat came."""
        self._quiet = 0
        if frame.heartbeat and self._timer is None:
            self._timer = self._clock.every(self._slice, self._look, first=self._slice)

    def end(self) -> None:
        """Look no more: the client is gone."""
        if self._timer is not None:
            self._timer.cancel()

    def _look(self) -> None:
        self._quiet += 1
        if self._quiet == SLICES:
            self._silent()
