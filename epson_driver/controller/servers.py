# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated controller as it stands on the network: four ports and a clock."""

from typing import NamedTuple

from epson_driver.controller.core import Controller
from epson_driver.controller.motion_server import MotionServer
from epson_driver.controller.pacer import Pacer
from epson_driver.controller.remote_server import RemoteServer
from epson_driver.controller.state_server import RequestServer, StateServer


class Ports(NamedTuple):
    """TCP ports; 0 asks for any free one."""

    motion: int = 11000
    state: int = 11002
    io: int = 11003
    remote: int = 5000


class ControllerServers:
    """Everything that listens for one controller. `state_period` is in s."""

    def __init__(self, controller: Controller, state_period: float | None = None) -> None:
        self.pacer = Pacer(controller)
        period = controller.profile.state_period if state_period is None else state_period
        self._servers = (
            MotionServer(self.pacer),
            StateServer(self.pacer, controller, period),
            RequestServer(controller.dialect),
            RemoteServer(self.pacer),
        )

    async def open(self, host: str, ports: Ports) -> Ports:
        """Listen on all ports and return them.

        Raises OSError that names the port which cannot be opened; none is open then.
        """
        try:
            return Ports(
                *[
                    await server.open(host, port)
                    for server, port in zip(self._servers, ports, strict=True)
                ]
            )
        except OSError:
            await self.close()
            raise

    async def run(self) -> None:
        """Move the arm when there is something to move, for ever."""
        await self.pacer.run()

    async def close(self) -> None:
        """Stop listening and disconnect everybody."""
        for server in self._servers:
            await server.close()
