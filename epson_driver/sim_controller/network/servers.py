# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated controller as it stands on the network: four ports, a clock, and a planner."""

import asyncio
from typing import NamedTuple

from epson_driver.sim_controller.arm.planner_process import PlannerError, PlannerProcess
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.network.pacer import Pacer
from epson_driver.sim_controller.network.port_server import PortServer, port_rules


class Ports(NamedTuple):
    """TCP ports; 0 asks for any free one."""

    motion: int = 11000
    state: int = 11002
    io: int = 11003
    remote: int = 5000


class ControllerServers:
    """The listening ports of one controller, its real time, and its planner process if any."""

    def __init__(self, controller: Controller, planner: PlannerProcess | None = None) -> None:
        self._controller = controller
        self._planner = planner
        self.pacer = Pacer(controller)
        rules = port_rules(controller.profile.server)
        turn = asyncio.Lock()
        self._servers = tuple(PortServer(each, self.pacer, turn) for each in rules)

    async def open(self, host: str, ports: Ports) -> Ports:
        """Start the planner, listen on all ports, and return them.

        Raises OSError that names the port which cannot be opened, or PlannerError; nothing is open
        then.
        """
        try:
            if self._planner is not None:
                await self._planner.start()
            return Ports(
                *[
                    await server.open(host, port)
                    for server, port in zip(self._servers, ports, strict=True)
                ]
            )
        except (OSError, PlannerError):
            await self.close()
            raise

    def clients(self, port: str) -> int:
        """Return how many clients of a port are connected, or wait for a place."""
        return sum(server.clients for server in self._servers if server.name == port)

    async def run(self) -> None:
        """Let the controller's time pass, for ever."""
        if self._planner is None:
            await self.pacer.run()
            return
        async with asyncio.TaskGroup() as group:
            group.create_task(self.pacer.run())
            group.create_task(
                self._planner.run(self._controller.planner_failed, self.pacer.present)
            )

    async def close(self) -> None:
        """Stop listening, disconnect everybody and end the planner."""
        for server in self._servers:
            await server.close()
        if self._planner is not None:
            await self._planner.close()
