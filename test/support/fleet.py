# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Two robot cells in one ROS domain, with one driver process each or one for all."""

from pathlib import Path

from epson_driver.processes import processes
from support import patient
from support.cell import TIMEOUTS
from support.controller_harness import do
from support.ros_peer import RosPeer

NAMES = ('left', 'right')


class Fleet:
    """A controller and a peer per name, and the drivers. The first joint identifies the robot."""

    def __init__(self, folder: Path, *, together: bool) -> None:
        self._folder = folder
        self.domain = processes.free_ros_domain()
        self.start = {name: [0.1 * i, *[0.0] * 5] for i, name in enumerate(NAMES, 1)}
        self.controllers = {name: self._start_controller(name) for name in NAMES}
        self.ports = {name: process.ports() for name, process in self.controllers.items()}
        self.clients = []
        for group in [NAMES] if together else [[name] for name in NAMES]:
            ports = {name: self.ports[name] for name in group}
            log = folder / f'client_{group[0]}.log'
            self.clients.append(
                processes.clients(log, ports, self.domain, run=patient.COMMAND, **TIMEOUTS)
            )
        self.peers = {name: RosPeer(self.domain, prefix=f'/{name}') for name in NAMES}

    def _start_controller(
        self, name: str, ports: processes.Ports | None = None
    ) -> processes.Process:
        start = ','.join(map(str, self.start[name]))
        log = self._folder / f'{name}.log'
        return processes.sim_controller(
            log, '--motion=ptp', '--state-period=0.02', f'--start={start}', ports=ports
        )

    def restart(self, name: str) -> None:
        """Start a controller again, after it was killed, on the same ports."""
        self.controllers[name] = self._start_controller(name, self.ports[name])

    def enabled(self) -> 'Fleet':
        for peer in self.peers.values():
            peer.wait_until_ready()
        for peer in self.peers.values():
            peer.enable()
        return self

    def pendant(self, name: str, *words: str) -> None:
        """Send a command to the simulated hand of one controller."""
        do(self.ports[name].remote, *words)

    def close(self) -> None:
        for peer in self.peers.values():
            peer.close()
        for process in (*self.clients, *self.controllers.values()):
            process.end()
