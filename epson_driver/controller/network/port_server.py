# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's listening TCP ports: sockets for the sessions of the core."""

import asyncio
import logging
import os
import socket
from typing import NamedTuple

from epson_driver.controller.network.connection import Connection
from epson_driver.controller.network.pacer import Pacer
from epson_driver.controllers.profile import ServerProfile
from epson_driver.simple_message import FrameError

HANDOVER = 0.1
"""How long a client waits for a place, s: one that reconnects meets its own end of before."""

_log = logging.getLogger(__name__)


class PortRules(NamedTuple):
    """What differs from port to port.

    A client that leaves more than `max_unsent` bytes unread is disconnected; `send_buffer` is what
    the system may hold beside that, None for its default. Where `half_closed`, a client that has
    shut its own side is still sent to.
    """

    name: str
    max_clients: int
    max_unsent: int = 65_536
    send_buffer: int | None = None
    half_closed: bool = False


def port_rules(server: ServerProfile) -> tuple[PortRules, ...]:
    """Return the rules of all ports, in the order of `servers.Ports`."""
    return (
        PortRules('motion', 1),
        PortRules('state', server.state_clients, 4096, 16_384, half_closed=True),  # a third of a s
        PortRules('io', server.io_clients, 16_384),
        PortRules('remote', 16, 16_384),
    )


class PortServer:
    """Accepts clients of one port and serves each in a task of its own.

    One client more than there may be is closed at once, and the others do not notice it.
    """

    def __init__(self, rules: PortRules, pacer: Pacer) -> None:
        self._rules = rules
        self._pacer = pacer
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._places = asyncio.Semaphore(rules.max_clients)

    async def open(self, host: str, port: int) -> int:
        """Listen, and return the port; 0 asks for any free one. Raises OSError that says where."""
        try:
            family = socket.AF_INET6 if ':' in host else socket.AF_INET
            sock = socket.create_server((host, port), family=family)
        except (OSError, OverflowError) as error:
            number = error.errno if isinstance(error, OSError) else None
            reason = os.strerror(number) if number is not None and number > 0 else str(error)
            raise OSError(f'{self._rules.name} port {host}:{port}: {reason}') from error
        if self._rules.send_buffer is not None:  # accepted sockets inherit it
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, self._rules.send_buffer)
        self._server = await asyncio.start_server(self._accept, sock=sock)
        bound: int = sock.getsockname()[1]
        return bound

    async def close(self) -> None:
        """Stop listening and disconnect everybody."""
        if self._server is not None:
            self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            connection = Connection(self._rules.name, reader, writer, self._rules.max_unsent)
        except (OSError, TypeError):  # gone before it was served
            writer.transport.abort()
            return
        task = asyncio.create_task(self._attend(connection))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _attend(self, connection: Connection) -> None:
        try:
            async with asyncio.timeout(HANDOVER):
                await self._places.acquire()
            try:
                _log.info('%s connected', connection.name)
                await self._serve(connection)
                _log.info('%s gone', connection.name)
            finally:
                self._places.release()
        except TimeoutError:
            _log.warning('%s refused: as many connected as may be', connection.name)
        except ConnectionRefusedError as error:
            _log.warning('%s refused: %s', connection.name, error)
            connection.abort()
        except FrameError as error:
            _log.warning('%s disconnected: %s', connection.name, error)
        finally:
            connection.close()

    async def _serve(self, connection: Connection) -> None:
        with self._pacer.present() as controller:
            line = controller.connect(self._rules.name, connection)
        try:
            while data := await connection.receive():
                with self._pacer.present():
                    line.receive(data)
            if self._rules.half_closed:
                await connection.lost()
        finally:
            with self._pacer.present():
                line.closed()
