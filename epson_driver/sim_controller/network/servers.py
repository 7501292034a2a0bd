# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated controller on the network: its ports, real time, and the planner process."""

import asyncio
import logging
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import NamedTuple

from epson_driver.rtmc.transport import Arrival, Transport, TransportError
from epson_driver.sim_controller.arm.planner_process import PlannerError, PlannerProcess
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.network.announcement import announce
from epson_driver.sim_controller.network.pacer import Pacer
from epson_driver.sim_controller.network.port_server import PortRules, PortServer, port_rules
from epson_driver.sim_controller.network.tcp_connection import TcpConnection
from epson_driver.sim_controller.rtmc_port import RtmcPort
from epson_driver.sim_controller.spel_host.program_network import PortObject, ProgramNetwork

HOST = '127.0.0.1'
RETRY_S = 0.2  # before a client port of a program connects again
MAX_UNSENT = 65_536

_log = logging.getLogger(__name__)


async def connect(session: PortObject, port: int, pacer: Pacer) -> None:
    """Connect a client port of a SPEL+ program, and forward data until either side closes."""
    writer = None
    while writer is None and session.is_open:
        try:
            reader, writer = await asyncio.open_connection(HOST, port)
        except OSError:
            await asyncio.sleep(RETRY_S)
    if writer is None:
        return
    link = TcpConnection(session.name, reader, writer, MAX_UNSENT)
    try:
        with pacer.present():
            if session.is_open:
                session.start(link.send, link.close)
        _log.info('port %s of the program is connected to %s:%d', session.name, HOST, port)
        while session.is_open and (data := await link.receive()):
            with pacer.present():
                session.receive(data)
    finally:
        link.close()
        with pacer.present():
            session.closed()
        with suppress(OSError):
            await link.lost()


class RtmcServer:
    """Serves Real-time Motion Control. `open` and `close` run in the event loop."""

    def __init__(self, pacer: Pacer, address: str, port: int) -> None:
        """Listen on `port`. Raises TransportError if this is not possible."""
        self._pacer = pacer
        self._transport = Transport(address, port)
        _log.info('real-time motion: UDP port %d of %s', port, address)
        with pacer.present() as controller:
            self._port = RtmcPort(controller, self._transport.write, self._poll)
        self._transport.listen(self._receive, pacer.fail)

    def _receive(self, arrival: Arrival) -> None:
        with self._pacer.present():
            self._port.receive(arrival.sender, arrival.data)

    def _poll(self, quiet: bool) -> None:
        for arrival in self._transport.poll(quiet=quiet):
            self._port.receive(arrival.sender, arrival.data)

    async def close(self) -> None:
        await self._transport.aclose()


class Ports(NamedTuple):
    """TCP ports. 0 selects any free port."""

    motion: int = 11000
    state: int = 11002
    io: int = 11003
    remote: int = 5000


class ControllerServers:
    """Runs one controller in real time, with its TCP ports and its planner process, if any.

    `spel` contains the ports of a SPEL+ program, which are served once the program opens them.
    `program_ports`: TCP port in the program → port to use instead (0: any free port). `rtmc_port`:
    UDP port of Real-time Motion Control (0: any free port, None: Real-time Motion Control is not
    served).
    """

    def __init__(
        self,
        controller: Controller,
        planner: PlannerProcess | None = None,
        spel: ProgramNetwork | None = None,
        program_ports: Mapping[int, int] | None = None,
        rtmc_port: int | None = None,
    ) -> None:
        self._controller = controller
        self._planner = planner
        self.pacer = Pacer(controller)
        rules = port_rules(controller.profile.server)
        self._turn = asyncio.Lock()
        self._servers = [PortServer(rule, self.pacer, self._turn) for rule in rules]
        self._host = ''
        self._program_ports = program_ports or {}
        if spel is not None:
            spel.listen = self._listen
            spel.connect = self._connect
        self._clients: set[asyncio.Task[None]] = set()
        self._announcement: socket.socket | None = None
        self._rtmc: RtmcServer | None = None
        self._rtmc_port = rtmc_port

    async def open(self, host: str, ports: Ports) -> Ports:
        """Start the planner, listen on all ports, and return their numbers.

        Raises PlannerError if the planner does not start, TransportError if Real-time Motion
        Control cannot be served, OSError if a port cannot be opened. All ports are then closed.
        """
        self._host = host
        try:
            if self._planner is not None:
                await self._planner.start()
            opened = Ports(
                *[
                    server.open(host, port)
                    for server, port in zip(self._servers, ports, strict=True)
                ]
            )
            if self._rtmc_port is not None:
                self._rtmc = RtmcServer(self.pacer, host, self._rtmc_port or opened.motion)
        except (OSError, PlannerError, TransportError):
            await self.close()
            raise
        try:
            address = host if ':' in host else socket.gethostbyname(host)
            self._announcement = announce(address, opened.remote)
        except OSError as error:
            text = 'not announced as simulated (%s): the panel treats this controller as real'
            _log.warning(text, error.strerror)
        return opened

    def _listen(self, tcp_port: int) -> None:
        """Serve a TCP port of the SPEL+ program.

        Listen on the configured port. If none is configured, listen on the same port as the
        program, or on any free port.
        """
        server = PortServer(PortRules(str(tcp_port), 1), self.pacer, self._turn)
        configured = self._program_ports.get(tcp_port)
        try:
            bound = server.open(self._host, tcp_port if configured is None else configured)
        except OSError:
            if configured is not None:
                raise
            bound = server.open(self._host, 0)
        self._servers.append(server)
        _log.info('port %d of the program is %s:%d', tcp_port, self._host, bound)

    def _connect(self, session: PortObject) -> None:
        port = self._program_ports.get(session.tcp_port) or session.tcp_port
        task = asyncio.get_running_loop().create_task(connect(session, port, self.pacer))
        self._clients.add(task)
        task.add_done_callback(self._clients.discard)
        task.add_done_callback(self.pacer.on_task_done)

    def clients(self, port: str) -> int:
        return sum(server.clients for server in self._servers if server.name == port)

    async def run(self) -> None:
        """Run the controller in real time until a step fails. Raises the step's exception."""
        if self._planner is None:
            await self.pacer.run()
        else:
            async with asyncio.TaskGroup() as group:
                group.create_task(self.pacer.run())
                group.create_task(
                    self._planner.run(self._controller.planner_failed, self.pacer.present)
                )

    async def run_until(self, over: asyncio.Event) -> None:
        running, ending = asyncio.create_task(self.run()), asyncio.create_task(over.wait())
        try:
            await asyncio.wait((running, ending), return_when=asyncio.FIRST_COMPLETED)
            if running.done():
                await running  # raises the exception that ended it
        finally:
            running.cancel()
            ending.cancel()

    async def close(self) -> None:
        if self._announcement is not None:
            self._announcement.close()
        for task in self._clients:
            task.cancel()
        for server in self._servers:
            await server.close()
        if self._rtmc is not None:
            await self._rtmc.close()
        if self._planner is not None:
            await self._planner.close()
