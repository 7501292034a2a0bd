# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A robot cell of real processes: a simulated controller, the driver's node and a ROS peer."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

from epson_driver.driver.stopping.motors import Action, RestartingMotors
from epson_driver.processes import processes
from support import patient
from support.controller_harness import do
from support.ros_peer import PATIENCE, RosPeer

processes.END_TIMEOUT_S = PATIENCE  # a process may not be scheduled for a long time

SLOW_PLANS = {'require_planned_speed': False}
"""Settings for slow plans, which leave time for events during a motion."""

TIMEOUTS = {'state_timeout': 45.0, 'io_timeout': 45.0, 'reply_timeout': 90.0}
"""A controller that is not scheduled does not count as silent. Tests of a timeout set it."""

LASTS = 60.0
"""Duration of a motion that a test interrupts, s, long enough for a slow machine."""

SPEL = '--controller=spel'
"""A controller with a SPEL+ program, which determines its motions and messages."""

PROGRAMS = ('built-in', pytest.param('spel', marks=pytest.mark.slow))
"""The controller's programs, for tests that apply to both (see `cell_with`)."""

START = [0.0, 0.1, 0.2, 0.0, -0.5, 0.0]


class Cell:
    """A controller, a driver and a peer with separate ports and ROS domain.

    The driver has long timeouts for busy machines (patient.py) unless `patience` is False.
    `run`: words before its command.
    """

    def __init__(
        self,
        folder: Path,
        *controller_arguments: str,
        patience: bool = True,
        run: tuple[str, ...] = (),
        **parameters: Any,
    ) -> None:
        self._folder = folder
        self._controller_arguments = controller_arguments
        self.spel = SPEL in controller_arguments or parameters.get('controller') == 'spel'
        self._parameters = SLOW_PLANS | (TIMEOUTS if patience else {}) | parameters
        self._run = [*run, *(patient.COMMAND if patience else processes.EXECUTABLE)]
        self.domain = processes.free_ros_domain()
        self.start = START
        self.controller = self._start_controller(None)
        self.ports = self.controller.ports()
        self.client = self._start_client()
        self.peer = RosPeer(self.domain)

    def ready(self) -> 'Cell':
        self.peer.wait_until_ready()
        return self

    def _start_controller(self, ports: processes.Ports | None) -> processes.Process:
        # a quarter of a C3's state messages, and of the work
        usual = () if self.spel else ('--motion=ptp', '--state-period=0.02')
        return processes.sim_controller(
            self._folder / 'controller.log',
            *usual,
            *self._controller_arguments,
            start=self.start,
            ports=ports,
        )

    def _start_client(self) -> processes.Process:
        log = self._folder / 'client.log'
        return processes.client(log, self.ports, self.domain, run=self._run, **self._parameters)

    def restart_controller(self, start: list[float] | None = None) -> None:
        """Restart the controller on the same ports."""
        self.start = START if start is None else start
        self.controller = self._start_controller(self.ports)
        self.controller.ports()

    def restart_client(self) -> None:
        """Restart the client with a new peer."""
        self.peer.close()
        self.client = self._start_client()
        self.peer = RosPeer(self.domain)
        self.ready()

    def pendant(self, *words: str) -> None:
        """Perform a user's action at the controller."""
        do(self.ports.remote, *words)

    def motors(self, on: bool) -> None:
        """Switch the motors. A SPEL+ program is stopped before, and started with them."""
        if not self.spel:
            self.pendant('motors', 'on' if on else 'off')
            return
        action = Action.MOTORS_ON if on else Action.MOTORS_OFF
        asyncio.run(RestartingMotors('127.0.0.1', self.ports.remote).act(action, PATIENCE))

    def close(self) -> None:
        self.peer.close()
        self.client.end()
        self.controller.end()


def cell_with(folder: Path, program: str, *arguments: str, **parameters: Any) -> Cell:
    """Return a cell whose controller runs one of PROGRAMS."""
    if program == 'spel':
        return Cell(folder, SPEL, *arguments, controller='spel', **parameters)
    return Cell(folder, *arguments, **parameters)
