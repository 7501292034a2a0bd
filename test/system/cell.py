# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One robot cell of real processes: a simulated controller, the driver's node, a ROS peer."""

import os
from pathlib import Path
from typing import Any

from ros_peer import RosPeer

from epson_driver.cli import processes

START = [0.0, 0.1, 0.2, 0.0, -0.5, 0.0]


class Cell:
    """One controller, one driver, one peer, on ports and a domain of their own."""

    def __init__(self, folder: Path, *controller_arguments: str, **parameters: Any) -> None:
        self._folder = folder
        self._controller_arguments = controller_arguments
        self._parameters = parameters
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
        return processes.sim_controller(
            self._folder / 'controller.log',
            '--motion=ptp',
            '--start=' + ','.join(map(str, self.start)),
            *self._controller_arguments,
            ports=ports,
        )

    def _start_client(self) -> processes.Process:
        return processes.client(
            self._folder / 'client.log', self.ports, self.domain, **self._parameters
        )

    def restart_controller(self, start: list[float] | None = None) -> None:
        """Start it again on the same ports."""
        self.start = START if start is None else start
        self.controller = self._start_controller(self.ports)
        self.controller.ports()

    def restart_client(self) -> None:
        self.client = self._start_client()

    def pendant(self, *words: str) -> None:
        """Do what a person does at the controller."""
        pendant = processes.Process(
            'pendant',
            ['--port', str(self.ports.remote), *words],
            self._folder / 'pendant.log',
            dict(os.environ),
        )
        assert pendant.wait() == 0, pendant.log_text()

    def close(self) -> None:
        self.peer.close()
        self.client.end()
        self.controller.end()
